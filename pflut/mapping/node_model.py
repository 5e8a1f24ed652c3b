"""How probable an image is at each node of a topological map: the evidence of its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pflut.features import Features, match_many
from pflut.geometry import FloatArray
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.link_evidence import LinkEvidence, link_evidence
from pflut.mapping.topological_map import TopologicalMap
from pflut.reference_map import NO_FEATURES
from pflut.retrieval import Vocabulary

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


NO_NODES = NodeMatches(
    np.empty(0, np.int64), LinkEvidence(np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64))
)


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
        Factor on the evidence in (0, 1]: the share of the matches that are independent.
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
        temperature: float = 0.3,
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
        for name, value in (("temperature", temperature), ("ratio", ratio)):
            if not 0.0 < value <= 1.0:
                raise ValueError(f"{name}: expected in (0, 1], got {value}")
        if not 0.0 < link_probability < 1.0:
            raise ValueError(f"link_probability: expected in (0, 1), got {link_probability}")
        if max_candidates < 1 or max_neighbours < 0:
            raise ValueError(
                "max_candidates, max_neighbours: expected at least 1 and 0, got "
                f"{max_candidates} and {max_neighbours}"
            )
        self.topological_map = topological_map
        self.features = tuple(features)
        self.table = table
        self.extractor = extractor
        self.temperature = temperature
        self.link_probability = link_probability
        self.max_candidates = max_candidates
        self.max_neighbours = max_neighbours
        self.ratio = ratio
        self.mutual = mutual
        self._vocabulary = Vocabulary.learn([f.descriptors for f in features])
        self._last: tuple[Features, NodeMatches] = (NO_FEATURES, NO_NODES)
        self._signatures = np.stack([self._vocabulary.signature(f.descriptors) for f in features])

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
        found: NDArray[np.float32] = self._signatures @ self._vocabulary.signature(
            features.descriptors
        )
        return found

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
            nodes = observation.nodes
            if len(nodes) and not 0 <= nodes.min() <= nodes.max() < len(self.features):
                raise ValueError(f"observation: expected nodes 0 to {len(self.features) - 1}")
            return observation
        if not isinstance(observation, Features):
            if self.extractor is None:
                raise ValueError(
                    "observation: an image, but the model was made without an extractor"
                )
            observation = self.extractor(observation)
        known = self._last[1] if self._last[0] is observation else NO_NODES
        nodes = self.candidates(probabilities, observation)
        known = self._with(known, np.setdiff1d(nodes, known.nodes), observation)
        self._last = observation, known
        rows = np.searchsorted(known.nodes, nodes)
        return NodeMatches(nodes, known.evidence[rows])

    def _with(self, known: NodeMatches, new: NDArray[np.int64], features: Features) -> NodeMatches:
        """Match an image with more nodes."""
        references = [self.features[node] for node in new]
        pairs = match_many(references, features, ratio=self.ratio, mutual=self.mutual)
        evidence = LinkEvidence.concatenate([known.evidence, link_evidence(pairs, self.table)])
        nodes = np.concatenate([known.nodes, new])
        order = np.argsort(nodes)
        return NodeMatches(nodes[order], evidence[order])

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
        evidence = np.zeros(len(self.features))
        evidence[matches.nodes] = self.temperature * matches.evidence.log_evidence
        linked = np.log(self.link_probability) + evidence
        return np.asarray(np.logaddexp(linked, np.log1p(-self.link_probability)))
