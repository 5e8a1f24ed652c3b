"""How probable an image is at each node of a topological map: the evidence of its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pflut.features import Features
from pflut.features.reference_matcher import ReferenceMatcher
from pflut.geometry import FloatArray
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.link_evidence import LinkEvidence, link_evidence
from pflut.mapping.topological_map import TopologicalMap
from pflut.posterior import check_temperature
from pflut.retrieval import Gallery

if TYPE_CHECKING:
    from pflut.features import FeatureExtractor


@dataclass(frozen=True, eq=False)
class NodeMatches:
    """The evidence for links of an image with some nodes.

    Parameters
    ----------
    nodes : array_like of shape (k,), int
        Each once.
    evidence : LinkEvidence
        Of k pairs.
    """

    nodes: NDArray[np.int64]
    evidence: LinkEvidence

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", np.asarray(self.nodes, dtype=np.int64).reshape(-1))
        if len(self.nodes) != len(self.evidence):
            raise ValueError(
                f"evidence: expected {len(self.nodes)} pairs, got {len(self.evidence)}"
            )
        if len(np.unique(self.nodes)) < len(self.nodes):
            raise ValueError("nodes: expected each once")


class NodeModel:
    """Log-likelihood of an image at the nodes of a map.

    The image is matched with the nodes that look most like it, and with the most probable ones and
    their neighbours. The evidence of the matches with a node, tempered, is its likelihood ratio:
    near a node an image shares more with it than farther away, so the evidence tells nodes of one
    room apart, where the probabilities of links do not.

    Parameters
    ----------
    topological_map : TopologicalMap
    features : sequence of Features
        Of its images.
    table : LikelihoodTable
    extractor : FeatureExtractor, optional
        Turns images into features. Without it only features are taken as observations.
    temperature : float
        Factor on the evidence in (0, 1]: the share of the matches that are independent. Less than
        for poses: what two rooms have in common, a robot sees in many images one after the other.
    link_probability : float
        In (0, 1): how probable it is beforehand that an image that was taken at a node is linked
        with it. The rest is a floor under the likelihood, so that a missing link, as in the dark,
        costs a bounded amount.
    max_candidates : int
        So many nodes are matched that look most like the image.
    max_neighbours : int
        And so many that are the most probable, or linked with probable ones.
    ratio : float
        Of the ratio test, in (0, 1].
    mutual : bool
        Whether matches must be each other's nearest.

    Raises
    ------
    ValueError
        If an option is out of its range, or there are not as many features as images.
    """

    def __init__(
        self,
        topological_map: TopologicalMap,
        features: Sequence[Features],
        table: LikelihoodTable,
        *,
        extractor: FeatureExtractor | None = None,
        temperature: float = 0.1,
        link_probability: float = 0.5,
        max_candidates: int = 15,
        max_neighbours: int = 15,
        ratio: float = 0.8,
        mutual: bool = True,
    ) -> None:
        if len(features) != len(topological_map):
            raise ValueError(
                f"features: expected {len(topological_map)}, one an image, got {len(features)}"
            )
        check_temperature(temperature)
        if not 0.0 < link_probability < 1.0:
            raise ValueError(f"link_probability: expected in (0, 1), got {link_probability}")
        if max_candidates < 1 or max_neighbours < 0:
            raise ValueError(
                "max_candidates, max_neighbours: expected at least 1 and 0, got "
                f"{max_candidates} and {max_neighbours}"
            )
        self.topological_map = topological_map
        self.table = table
        self.extractor = extractor
        self.temperature = temperature
        self.link_probability = link_probability
        self.max_candidates = max_candidates
        self.max_neighbours = max_neighbours
        self._matcher = ReferenceMatcher(features, ratio=ratio, mutual=mutual)
        self._gallery = Gallery.learn([f.descriptors for f in features])

    def similarity(self, features: Features) -> NDArray[np.float32]:
        """Compare an image with all nodes by its visual words, without matching.

        Parameters
        ----------
        features : Features

        Returns
        -------
        ndarray of shape (N,)
            Cosines in [-1, 1].
        """
        return self._gallery.similarity(features.descriptors)

    def candidates(self, probabilities: FloatArray | None, features: Features) -> NDArray[np.int64]:
        """Choose the nodes worth matching with an image.

        Parameters
        ----------
        probabilities : ndarray of shape (N,) or None
            Where the robot may be; None is anywhere.
        features : Features
            Of the image.

        Returns
        -------
        ndarray of int
            In ascending order.
        """
        alike = np.argsort(-self.similarity(features), kind="stable")[: self.max_candidates]
        if probabilities is None:
            return np.sort(alike)
        first, second = self.topological_map.edges.T
        likely, count = self.topological_map.probability, len(self.topological_map)
        # as probable as the likeliest way of one hop, or of none
        reached = np.array(probabilities, dtype=np.float64)
        np.maximum.at(reached, second, likely * probabilities[first])
        np.maximum.at(reached, first, likely * probabilities[second])
        # where nothing is known all are as probable, and none is worth it
        reached[reached <= 1.0 / count + 1e-9] = 0.0
        near = np.argsort(-reached, kind="stable")[: self.max_neighbours]
        return np.union1d(alike, near[reached[near] > 0.0])

    def match(self, probabilities: FloatArray | None, observation: Any) -> NodeMatches:
        """Match an image with the nodes worth it.

        Parameters
        ----------
        probabilities : ndarray of shape (N,) or None
            Where the robot may be; None is anywhere.
        observation : Features, image or NodeMatches
            What was matched already is not matched again.

        Returns
        -------
        NodeMatches

        Raises
        ------
        ValueError
            If a match is with no node of the map; or if there is an image, and no extractor.
        """
        if isinstance(observation, NodeMatches):
            nodes, last = observation.nodes, len(self.topological_map) - 1
            if len(nodes) and not 0 <= nodes.min() <= nodes.max() <= last:
                raise ValueError(f"observation: expected nodes 0 to {last}")
            return observation
        if not isinstance(observation, Features):
            if self.extractor is None:
                raise ValueError(
                    "observation: an image, but the model was made without an extractor"
                )
            observation = self.extractor(observation)
        nodes = self.candidates(probabilities, observation)
        pairs = self._matcher(observation, nodes.tolist())
        return NodeMatches(nodes, link_evidence(pairs, self.table))

    def log_likelihood(self, probabilities: FloatArray | None, observation: Any) -> FloatArray:
        """Compute the log-likelihood of an observation at all nodes.

        Parameters
        ----------
        probabilities : ndarray of shape (N,) or None
            Where the robot may be; None is anywhere.
        observation : Features, image or NodeMatches

        Returns
        -------
        ndarray of shape (N,)
            Up to a constant: zero at a node that was not matched, or has no matches. Always finite.
        """
        matches = self.match(probabilities, observation)
        evidence = np.zeros(len(self.topological_map))
        evidence[matches.nodes] = self.temperature * matches.evidence.log_evidence
        linked = np.log(self.link_probability) + evidence
        return np.asarray(np.logaddexp(linked, np.log1p(-self.link_probability)))
