"""Localization in a topological map: the Bayes filter over its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray
from pflut.localization.weights import Weights
from pflut.mapping.node_walk import NodeWalk
from pflut.mapping.topological_map import TopologicalMap


class NodeSensor(Protocol):
    """What the filter asks of a sensor model."""

    def log_likelihood(self, probabilities: FloatArray, observation: Any) -> ArrayLike:
        """Give the observation's log-likelihood at each node.

        Parameters
        ----------
        probabilities : ndarray of shape (N,)
            Where the robot may be, before the observation; not to be changed.
        observation : object
            Whatever `NodeLocalizer.update` was handed.

        Returns
        -------
        array_like of shape (N,)
            Up to a constant; -inf rules a node out.
        """
        ...  # pragma: no cover


@dataclass(frozen=True, eq=False)
class NodeEstimate:
    """Where the robot is in a topological map.

    Parameters
    ----------
    node : int
        The most probable one.
    probability : float
        Of it.
    place : int
        The most probable one, which need not be that of the node.
    place_probability : float
        Of it: of all its nodes together.
    effective_nodes : float
        Over how many nodes the probability is spread, in [1, N], as an effective sample size.
    log_mean_likelihood : float, optional
        Of the last observation: how well it was expected.
    degenerate : bool
        Whether the last observation was ignored, because its likelihood held a NaN or +inf, or
        ruled out every node.
    """

    node: int
    probability: float
    place: int
    place_probability: float
    effective_nodes: float
    log_mean_likelihood: float | None = None
    degenerate: bool = False


class NodeLocalizer:
    """The Bayes filter over the nodes of a topological map.

    It predicts and updates as `ParticleFilter` does, with the same weights. But nodes can be
    counted, so each has a weight, and nothing is sampled: what particles would approximate is
    computed exactly, in the time that as many particles as nodes would take.

    Parameters
    ----------
    topological_map : TopologicalMap
    sensor : NodeSensor
        Weighs nodes: `NodeModel`, or an object with its ``log_likelihood``.
    walk : NodeWalk, optional

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), table 4.1.
    """

    def __init__(
        self,
        topological_map: TopologicalMap,
        sensor: NodeSensor,
        *,
        walk: NodeWalk = NodeWalk(),  # noqa: B008 (frozen)
    ) -> None:
        self.topological_map = topological_map
        self.sensor = sensor
        self.walk = walk
        self._weights = Weights.uniform(len(topological_map))

    @property
    def probabilities(self) -> FloatArray:
        """Of the nodes, shape (N,); they sum to one."""
        return self._weights.linear.copy()

    @property
    def place_probabilities(self) -> FloatArray:
        """Of the places, shape (P,); they sum to one."""
        shares = np.bincount(self.topological_map.places, weights=self._weights.linear)
        return np.asarray(shares, dtype=np.float64)

    def initialize(self, probabilities: ArrayLike | None = None) -> None:
        """Start again.

        Parameters
        ----------
        probabilities : array_like of shape (N,), optional
            Of the nodes, not necessarily normalised. Default: the robot may be at any node.

        Raises
        ------
        ValueError
            If there are not N of them, one is negative or not finite, or all are zero.
        """
        count = len(self.topological_map)
        if probabilities is None:
            self._weights = Weights.uniform(count)
            return
        values = np.asarray(probabilities, dtype=np.float64)
        if values.shape != (count,) or not (values >= 0.0).all():
            raise ValueError(f"probabilities: expected {count} numbers >= 0, one a node")
        self._weights = _of_probabilities(values)

    def predict(self, odometry: ArrayLike | None = None) -> None:
        """Let the robot walk.

        Parameters
        ----------
        odometry : array_like of shape (3,), optional
            The motion since the last call in the robot's own old frame, metres and radians. Where
            there is none, the walk says how far a robot goes.

        Raises
        ------
        ValueError
            If the odometry is not three finite numbers.
        """
        walked = self.walk.predict(self.topological_map, self._weights.linear, odometry)
        self._weights = _of_probabilities(walked)

    def update(self, observation: Any) -> NodeEstimate:
        """Weight the nodes with an observation.

        Parameters
        ----------
        observation : object
            Handed to the sensor model.

        Returns
        -------
        NodeEstimate

        Raises
        ------
        ValueError
            If the sensor model answers with another shape.
        """
        answer = self.sensor.log_likelihood(self.probabilities, observation)
        log_likelihood = np.ascontiguousarray(answer, dtype=np.float64)
        if log_likelihood.shape != (len(self.topological_map),):
            raise ValueError(
                f"sensor.log_likelihood: expected shape ({len(self.topological_map)},), "
                f"got {log_likelihood.shape}"
            )
        weights = self._weights.times(log_likelihood)
        if weights is None:
            return self._estimate(None, degenerate=True)
        self._weights = weights
        return self._estimate(weights.log_mean, degenerate=False)

    def step(self, odometry: ArrayLike | None, observation: Any) -> NodeEstimate:
        """Predict, then update: one turn of the loop.

        Parameters
        ----------
        odometry : array_like of shape (3,) or None
            As in `predict`.
        observation : object
            As in `update`.

        Returns
        -------
        NodeEstimate
        """
        self.predict(odometry)
        return self.update(observation)

    def estimate(self) -> NodeEstimate:
        """Say where the robot is now, as after a `predict`.

        Returns
        -------
        NodeEstimate
        """
        return self._estimate(None, degenerate=False)

    def _estimate(self, log_mean: float | None, *, degenerate: bool) -> NodeEstimate:
        node, place = int(np.argmax(self._weights.linear)), self.place_probabilities
        return NodeEstimate(
            node,
            float(self._weights.linear[node]),
            int(np.argmax(place)),
            min(float(place.max()), 1.0),
            self._weights.effective_sample_size,
            log_mean,
            degenerate,
        )


def _of_probabilities(values: FloatArray) -> Weights:
    with np.errstate(divide="ignore"):
        return Weights.from_log(np.log(values))
