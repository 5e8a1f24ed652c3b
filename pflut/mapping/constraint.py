"""What the posterior of a pair of images says to a map: a constraint of one of four kinds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.posterior import GridPosterior
from pflut.von_mises.distribution import VonMises
from pflut.von_mises.mixture import VonMisesMixture

KINDS = ("pose", "headings", "rotation", "none")
"""See `PoseConstraint`."""
SAME_ROTATION = np.radians(30.0)
"""Components whose rotations differ by less speak of one."""


@dataclass(frozen=True, eq=False)
class PoseConstraint:
    """A density over the relative pose of two images, and what it constrains.

    Parameters
    ----------
    kind : {"pose", "headings", "rotation", "none"}
        "pose": the mass lies in one or more compact modes. "headings": the rotation is known and
        there are two headings, as of a short baseline whose direction may be the opposite one.
        "rotation": the rotation is known, the headings are not: a turn on the spot. "none":
        nothing that a map could use.
    mixture : VonMisesMixture
        Fitted to the posterior.
    entropy : float
        Differential entropy of the posterior, nats; 3.68 where nothing is known.
    divergence : float
        Kullback-Leibler divergence of the posterior from the mixture, nats.

    Raises
    ------
    ValueError
        If the kind is none of the four.
    """

    kind: str
    mixture: VonMisesMixture
    entropy: float
    divergence: float

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {self.kind!r}")

    def log_density(self, headings: ArrayLike) -> FloatArray:
        """Return the mixture's log-density at poses, see `VonMisesMixture.log_density`."""
        return self.mixture.log_density(headings)

    def rotation(self) -> VonMises:
        """Return the rotation psi as one von Mises distribution.

        Returns
        -------
        VonMises
            Of the heaviest component and those of the same rotation, by their moments; uniform
            where there is no component.
        """
        weights, means, concentrations = self.mixture.rotation_components()
        if not len(weights):
            return VonMises(0.0, 0.0)
        best = int(np.argmax(weights))
        near = np.abs(wrap_to_pi(means - means[best])) < SAME_ROTATION
        return VonMises.of_components(weights[near], means[near], concentrations[near])


def extract_constraint(posterior: GridPosterior) -> PoseConstraint:
    """Fit a mixture to a posterior and name what it constrains.

    Parameters
    ----------
    posterior : GridPosterior

    Returns
    -------
    PoseConstraint
    """
    raise NotImplementedError("the fit is being written")
