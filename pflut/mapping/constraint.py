"""What the posterior of a pair of images says to a map: a constraint of one of four kinds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.posterior import GridPosterior
from pflut.von_mises.distribution import VonMises
from pflut.von_mises.fit import fit_mixture
from pflut.von_mises.mixture import MAX_COMPONENTS, VonMisesMixture

KINDS = ("pose", "headings", "rotation", "none")
"""See `PoseConstraint`."""
KNOWN_SHARE = 0.8
"""Of a marginal, that decides whether an angle is known."""
KNOWN_ROTATION, OPEN_HEADING = np.radians([20.0, 60.0])
"""Widths up to which the rotation is known, and from which on the heading is not."""
GAP = np.radians(10.0)
"""Between two arcs."""
ARC_SHARE = 0.15
"""Probability that makes an arc count."""
COMPACT_SHARE = 0.01
"""Of all poses, that a posterior without a rotation may be spread over."""
COMPONENTS_OF_NONE = 8
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
        nothing that a map could use of this pair alone.
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


def extract_constraint(
    posterior: GridPosterior, *, max_components: int = MAX_COMPONENTS
) -> PoseConstraint:
    """Fit a mixture to a posterior and name what it constrains.

    Parameters
    ----------
    posterior : GridPosterior
    max_components : int
        Of the mixture; of a posterior of the kind "none", of which a map learns little, at most 8.

    Returns
    -------
    PoseConstraint

    Raises
    ------
    ValueError
        If the number is not positive.
    """
    kind = classify(posterior)
    limit = min(max_components, COMPONENTS_OF_NONE) if kind == "none" else max_components
    mixture, divergence = fit_mixture(posterior.log_prob, posterior.prob, max_components=limit)
    entropy = posterior.entropy() + 2.0 * float(np.log(TWO_PI / posterior.bins))
    return PoseConstraint(kind, mixture, entropy, max(divergence, 0.0))


def classify(posterior: GridPosterior) -> str:
    """Name what a posterior constrains, see `PoseConstraint`.

    Parameters
    ----------
    posterior : GridPosterior

    Returns
    -------
    str
        One of `KINDS`.

    Notes
    -----
    The rotation is known where the smallest set of angles with 80 % of its marginal is at most 20
    degrees wide, and in one arc. Then the set of heading_l decides: wider than 60 degrees is a
    "rotation", two arcs, each with 15 % or more of the mass, are two "headings", everything else is
    a "pose". Where the rotation is not known, a "pose" is a posterior with the entropy of a uniform
    density over a hundredth of all poses, or less.
    """
    width, masses = arcs(posterior.rotation()[1], KNOWN_SHARE)
    if width <= KNOWN_ROTATION and int((masses >= ARC_SHARE).sum()) == 1:
        width, masses = arcs(posterior.heading_l(), KNOWN_SHARE)
        if width > OPEN_HEADING:
            return "rotation"
        return "headings" if int((masses >= ARC_SHARE).sum()) == 2 else "pose"
    known = 2.0 * np.log(posterior.bins) - posterior.entropy()
    return "pose" if known >= -np.log(COMPACT_SHARE) else "none"


def arcs(marginal: ArrayLike, share: float) -> tuple[float, FloatArray]:
    """Find the smallest set of an angle's bins that holds a share, as arcs.

    Parameters
    ----------
    marginal : array_like of shape (B,)
        Probabilities of the bins of a circle; their sum is one.
    share : float
        In (0, 1].

    Returns
    -------
    width : float
        Of all arcs together, radians.
    masses : ndarray of shape (n,)
        Of the arcs, descending. Gaps of up to 10 degrees do not part them.
    """
    mass = np.asarray(marginal, dtype=np.float64)
    bins = len(mass)
    order = np.argsort(-mass, kind="stable")
    number = int(np.searchsorted(np.cumsum(mass[order]), share * mass.sum() * (1.0 - 1e-12))) + 1
    chosen = np.sort(order[:number])
    # from each chosen bin to the next one around the circle
    steps = np.diff(chosen, append=chosen[0] + bins)
    breaks = np.flatnonzero(steps * (TWO_PI / bins) > GAP + TWO_PI / bins)
    # the arc before the first break goes on after the last one
    arc = np.searchsorted(breaks, np.arange(len(chosen))) % max(len(breaks), 1)
    masses = np.bincount(arc, weights=mass[chosen]).astype(np.float64)
    return len(chosen) * TWO_PI / bins, -np.sort(-masses)
