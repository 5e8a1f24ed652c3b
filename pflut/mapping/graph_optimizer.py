"""Optimise a pose graph whose links may be ambiguous or false.

The cost is minus the log of the posterior density: odometry is normal, and each link a mixture of
its components and of nothing being known (`LinkTerms`), so that a false link lets go by itself.
Such a cost has many minima, and is descended (expectation maximization, each step one of Levenberg
and Marquardt) from three places, of which the lowest end is taken:

1. Where the nodes are.
2. Growth. All links are weighted against where they are predicted to be, with the uncertainty of
   that prediction; those whose prediction is too vague to judge them wait until others have made
   it sharper.
3. The minimum with a Cauchy kernel, which is broad, on every link that is more probable than not.

References
----------
Olson, Agarwal, "Inference on networks of mixtures for robust robot mapping", International Journal
of Robotics Research 32 (2013): mixtures in pose graphs, of which the best component is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, wrap_to_pi
from pflut.mapping.graph_system import GraphSystem, Loss
from pflut.mapping.links import LINKED
from pflut.mapping.pose_graph import PoseGraph

GROWTH_ROUNDS = 12
VAGUE = 0.4
"""Radians: a link waits while the headings between its nodes are predicted with more, together."""
ROUNDS = 8
"""Rounds of the final descent; in each the distances of the nodes are taken anew."""
SETTLED = 1e-3
"""Metres and radians: a round that moves no node farther is the last one."""

__all__ = ["Loss", "OptimizedGraph", "optimize_graph"]


@dataclass(frozen=True, eq=False)
class OptimizedGraph:
    """Where the images of a pose graph were taken, in the light of all that is known.

    Parameters
    ----------
    graph : PoseGraph
        With its nodes at the optimum.
    link_probability : ndarray of shape (m,)
        That each link is right, after seeing all others.
    shares : ndarray of shape (c,)
        Of that, the part of each component: first the modes of all links, then their bands.
    cost : float
        At the optimum, nats.
    iterations : int
        Linear systems solved.
    converged : bool
        Whether the last round moved nothing.
    """

    graph: PoseGraph
    link_probability: FloatArray
    shares: FloatArray
    cost: float
    iterations: int
    converged: bool
    _system: GraphSystem = field(repr=False)

    @property
    def poses(self) -> FloatArray:
        """The nodes, of shape (n, 3)."""
        return self.graph.poses

    @property
    def believed(self) -> NDArray[np.intp]:
        """Which links are more probable than not, and say something by themselves."""
        probable = self.link_probability >= LINKED
        return np.flatnonzero(probable & self.graph.links.says_something)

    def covariances(self) -> FloatArray:
        """Give the nodes' covariances relative to the fixed node, of shape (n, 3, 3).

        Of ``[x, y, heading]`` in the world, metres and radians, to first order, the links being
        right or wrong as they are believed to be.
        """
        n = len(self.graph)
        nodes = np.stack([np.arange(n), np.arange(n)], axis=1)
        shares = self.shares[self._system.terms.component]
        covariances = self._system.pair_covariances(self.poses, shares, nodes)
        return np.asarray(covariances[:, :3, :3])


def optimize_graph(
    graph: PoseGraph,
    *,
    loss: Loss = "mixture",
    search: bool = True,
    heading_noise: float = 0.01,
    position_noise: float = 0.01,
) -> OptimizedGraph:
    """Find the most probable poses of a graph's nodes.

    Parameters
    ----------
    graph : PoseGraph
        Its poses are where the search begins.
    loss : {"mixture", "max-mixture", "gaussian", "huber", "cauchy"}
        What the links are taken for. "mixture": their mixtures, with all components. "max-mixture":
        at each moment the best one. The others take the heaviest component of each link that is
        more probable than not, and believe it (to compare with): "huber" and "cauchy" with the
        robust kernels of that name.
    search : bool
        Whether the two mixtures are descended from all three places, or only from where the nodes
        are.
    heading_noise : float
        Standard deviation, radians, added to the headings of every link: what posteriors do not
        know of, as a camera that is not upright.
    position_noise : float
        Metres, likewise: over the distance of the images it is an angle, added to the direction of
        the line between them. It keeps images of one place from being turned about each other.

    Returns
    -------
    OptimizedGraph

    Raises
    ------
    ValueError
        If an option is out of its range.
    ImportError
        If SciPy is not installed.
    """
    choices = ("mixture", "max-mixture", "gaussian", "huber", "cauchy")
    if loss not in choices:
        raise ValueError(f"loss: expected one of {', '.join(choices)}, got {loss!r}")
    for name, value in (("heading_noise", heading_noise), ("position_noise", position_noise)):
        if not 0.0 < value < np.inf:
            raise ValueError(f"{name}: expected a number above 0, got {value}")
    system = GraphSystem(graph, loss, heading_noise, position_noise)
    iterations = 0
    starts = [graph.poses.copy()]
    if search and loss in ("mixture", "max-mixture"):
        broad = GraphSystem(graph, "cauchy", heading_noise, position_noise)
        grown, first = _grown(system, graph.poses)
        settled, second, _ = _settled(broad, graph.poses)
        starts, iterations = [*starts, grown, settled], first + second
    ends = []
    for start in starts:
        poses, steps, converged = _settled(system, start)
        iterations += steps
        system.set_noise(poses)
        ends.append((system.shares(poses)[1], poses, converged))
    _, poses, converged = min(ends, key=lambda end: end[0])
    system.set_noise(poses)
    shares, cost = system.shares(poses)
    probability = np.zeros(len(graph.links))
    np.add.at(probability, system.terms.link, shares)
    of_all = np.zeros(len(graph.links.weights) + len(graph.links.rotation_weights))
    of_all[system.terms.component] = shares
    poses = np.column_stack([poses[:, :2], wrap_to_pi(poses[:, 2])])
    return OptimizedGraph(
        graph.with_poses(poses),
        np.minimum(probability, 1.0),
        of_all,
        cost,
        iterations,
        converged,
        system,
    )


def _settled(system: GraphSystem, poses: FloatArray) -> tuple[FloatArray, int, bool]:
    """Descend until the distances of the nodes, and the noise that goes with them, stay."""
    iterations = 0
    for _ in range(ROUNDS):
        system.set_noise(poses)
        found, steps = system.descend(poses)
        iterations += steps
        moved = np.abs(_difference(found, poses)).max(initial=0.0)
        poses = found
        if moved < SETTLED:
            return poses, iterations, True
    return poses, iterations, False


def _grown(system: GraphSystem, poses: FloatArray) -> tuple[FloatArray, int]:
    """Take in the links in the order in which they can be judged."""
    shares = np.zeros(len(system.terms.link))
    iterations = 0
    for _ in range(GROWTH_ROUNDS):
        predicted = system.predicted(poses, shares)
        vague = np.sqrt(np.trace(predicted, axis1=1, axis2=2)) > VAGUE
        system.set_noise(poses, predicted)
        before, (shares, _) = shares, system.shares(poses)
        # a rotation may be certain long before the headings are
        turn = predicted[:, 0, 0] - 2.0 * predicted[:, 0, 1] + predicted[:, 1, 1]
        of = system.terms.link
        waits = np.where(system.terms.band, turn[of] > VAGUE**2, vague[of])
        shares = np.where(waits, 0.0, shares)
        system.set_noise(poses)
        found, steps = system.descend(poses, shares)
        iterations += steps
        moved = np.abs(_difference(found, poses)).max(initial=0.0)
        poses = found
        if moved < SETTLED and np.abs(shares - before).max(initial=0.0) < 0.01:
            break
    return poses, iterations


def _difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """Give the difference of poses, headings wrapped."""
    difference = a - b
    difference[:, 2] = wrap_to_pi(difference[:, 2])
    return difference
