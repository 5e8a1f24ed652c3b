"""From the features of two images to their link: matches, posterior, constraint, probability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pflut
from pflut._jit import compiled_here
from pflut.correspondences import Correspondences
from pflut.features import Features, match_many
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.constraint import PoseConstraint, extract_constraint
from pflut.mapping.link_evidence import link_evidence
from pflut.mapping.link_model import LinkModel, checked_prior
from pflut.mapping.links import Links
from pflut.posterior import check_temperature, pose_posterior
from pflut.von_mises.mixture import VonMisesMixture

#: Of a pair without a posterior.
NOTHING_KNOWN = PoseConstraint(
    kind="none",
    mixture=VonMisesMixture(uniform_weight=1.0),
    entropy=float(2.0 * np.log(2.0 * np.pi)),
    divergence=0.0,
)


# 32 binary descriptors, each far from the others
_BITS = np.packbits(np.repeat(np.eye(32, dtype=np.uint8), 8, axis=1), axis=1)


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """How images are matched, and what their matches are worth.

    Parameters
    ----------
    ratio : float
        Of the ratio test, in (0, 1].
    mutual : bool
        Whether matches must be each other's nearest.
    min_matches : int
        A pair with fewer gets no posterior: its constraint says nothing.
    min_probability : float
        Nor does a pair that is linked less probably, in [0, 1].
    temperature : float
        Of the posteriors: factor on the log-likelihood in (0, 1], see `pose_posterior`.
    prior : float, optional
        Share in (0, 1) of linked pairs among all, see `LinkModel.log_odds`. Default: the model's.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    ratio: float = 0.8
    mutual: bool = True
    min_matches: int = 4
    min_probability: float = 0.01
    temperature: float = 0.3
    prior: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.ratio <= 1.0:
            raise ValueError(f"ratio: expected a number in (0, 1], got {self.ratio}")
        if self.min_matches < 1:
            raise ValueError(f"min_matches: expected at least 1, got {self.min_matches}")
        if not 0.0 <= self.min_probability <= 1.0:
            raise ValueError(
                f"min_probability: expected a number in [0, 1], got {self.min_probability}"
            )
        check_temperature(self.temperature)
        if self.prior is not None:
            checked_prior(self.prior)


@dataclass(frozen=True, eq=False, kw_only=True)
class PairLinker:
    """Link pairs of images whose features are given.

    Parameters
    ----------
    table : LikelihoodTable
        Its bins are those of the posteriors.
    options : LinkOptions
    link_model : LinkModel
        That judges evidence of this table.
    """

    table: LikelihoodTable
    options: LinkOptions
    link_model: LinkModel

    def __call__(self, features: Mapping[int, Features], pairs: NDArray[np.integer]) -> Links:
        """Link pairs.

        Parameters
        ----------
        features : mapping of int to Features
            Of the images that the pairs name.
        pairs : ndarray of shape (n, 2), int
            Of images, the smaller index first.

        Returns
        -------
        Links
            In the order of the pairs. Each pair's is the same whatever the other pairs are.
        """
        return self.of_matches(self._matched(features, pairs), pairs)

    def of_matches(
        self, correspondences: Sequence[Correspondences], pairs: NDArray[np.integer]
    ) -> Links:
        """Link pairs that are matched already.

        Parameters
        ----------
        correspondences : sequence of n Correspondences
            L is the first image of the pair.
        pairs : ndarray of shape (n, 2), int

        Returns
        -------
        Links
        """
        options = self.options
        evidence = link_evidence(correspondences, self.table)
        probability = self.link_model.probability(evidence, prior=options.prior)
        worth = (evidence.num_matches >= options.min_matches) & (
            probability >= options.min_probability
        )
        constraints = [
            extract_constraint(pose_posterior(matches, self.table, temperature=options.temperature))
            if chosen
            else NOTHING_KNOWN
            for matches, chosen in zip(correspondences, worth, strict=True)
        ]
        return Links.of(
            pairs, evidence.num_matches, evidence.log_evidence, probability, constraints
        )

    def _matched(
        self, features: Mapping[int, Features], pairs: NDArray[np.integer]
    ) -> list[Correspondences]:
        """Match all pairs, those of a query image one after the other."""
        found = [Correspondences.empty()] * len(pairs)
        for query in np.unique(pairs[:, 1]):
            rows = np.flatnonzero(pairs[:, 1] == query)
            references = [features[int(image)] for image in pairs[rows, 0]]
            matches = match_many(
                references,
                features[int(query)],
                ratio=self.options.ratio,
                mutual=self.options.mutual,
            )
            for row, one in zip(rows, matches, strict=True):
                found[row] = one
        return found

    def warm_up(self) -> bool:
        """Link two images that see the same, so that all kernels are loaded or compiled.

        Returns
        -------
        bool
            Whether this process has compiled some, see `pflut._jit.compiled_here`.
        """
        count = 32
        rng = np.random.default_rng(0)
        azimuth, elevation = rng.uniform(0.0, 6.0, count), rng.uniform(-0.5, 0.5, count)
        none = np.zeros((count, 2), np.float32), np.zeros(count, np.float32)
        whatever = replace(self, options=replace(self.options, min_matches=1, min_probability=0.0))
        # of either kind, that of SIFT and that of ORB
        for descriptors in (np.eye(count, dtype=np.float32), _BITS):
            features = Features(azimuth, elevation, descriptors, *none)
            whatever({0: features, 1: features}, np.array([[0, 1]]))
        return compiled_here()

    def record(self) -> dict[str, Any]:
        """Say what the links depend on besides the features, for a JSON file."""
        table, model = self.table, self.link_model
        return {
            "pflut": pflut.__version__,
            "table": {"bins": table.bins, "digest": table.digest},
            "link_model": {
                "features": list(model.features),
                "weights": model.weights.tolist(),
                "bias": model.bias,
                "prior": model.prior,
            },
            "options": asdict(self.options),
        }
