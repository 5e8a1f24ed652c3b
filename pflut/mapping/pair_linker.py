"""From the features of two images to their link: matches, posterior, constraint, probability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.features import Features, match_many
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.constraint import PoseConstraint, extract_constraint
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.posterior import check_temperature, pose_posterior
from pflut.von_mises.mixture import VonMisesMixture

Likelihood = LikelihoodTable | DenseTable

#: Of a pair with too few matches for a posterior.
NOTHING_KNOWN = PoseConstraint(
    kind="none",
    mixture=VonMisesMixture(uniform_weight=1.0),
    entropy=float(2.0 * np.log(2.0 * np.pi)),
    divergence=0.0,
)


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
    temperature : float
        Factor on the log-likelihood in (0, 1], see `pose_posterior`.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    ratio: float = 0.8
    mutual: bool = True
    min_matches: int = 4
    temperature: float = 0.3

    def __post_init__(self) -> None:
        if not 0.0 < self.ratio <= 1.0:
            raise ValueError(f"ratio: expected a number in (0, 1], got {self.ratio}")
        if self.min_matches < 1:
            raise ValueError(f"min_matches: expected at least 1, got {self.min_matches}")
        check_temperature(self.temperature)


@dataclass(frozen=True, eq=False, kw_only=True)
class PairLinker:
    """Link pairs of images whose features are given.

    Parameters
    ----------
    likelihood : LikelihoodTable or DenseTable
        Its bins are those of the posteriors.
    options : LinkOptions
    link_model : LinkModel
    """

    likelihood: Likelihood
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
        options = self.options
        correspondences = self._matched(features, pairs)
        evidence, constraints = [], []
        for matches in correspondences:
            if len(matches) < options.min_matches:
                evidence.append(0.0)
                constraints.append(NOTHING_KNOWN)
                continue
            posterior = pose_posterior(matches, self.likelihood, temperature=options.temperature)
            evidence.append(posterior.log_evidence)
            constraints.append(extract_constraint(posterior))
        counts = np.array([len(matches) for matches in correspondences], dtype=np.int64)
        log_evidence = np.array(evidence, dtype=np.float64)
        probability = self.link_model.probability(num_matches=counts, log_evidence=log_evidence)
        return Links.of(pairs, counts, log_evidence, probability, constraints)

    def _matched(
        self, features: Mapping[int, Features], pairs: NDArray[np.integer]
    ) -> list[Correspondences]:
        """Match all pairs, those of a query image one after the other."""
        found = [Correspondences.empty()] * len(pairs)
        for query in np.unique(pairs[:, 1]):
            rows = np.flatnonzero(pairs[:, 1] == query)
            # an image without features has descriptors of no kind
            rows = rows[[len(features[int(image)]) > 0 for image in pairs[rows, 0]]]
            if not len(features[int(query)]):
                continue
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

    def record(self) -> dict[str, Any]:
        """Say what the links depend on besides the features, for a JSON file."""
        table = self.likelihood
        return {
            "table": {"bins": table.bins, "learned_from": table.learned_from},
            "link_model": self.link_model.record(),
            "options": asdict(self.options),
        }
