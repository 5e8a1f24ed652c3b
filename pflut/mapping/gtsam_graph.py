"""The same pose graph for GTSAM (the extra ``gtsam``): a factor a link, with its whole mixture.

    factors, values = gtsam_graph(graph)
    result = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    poses = poses_of(result, graph)

Add factors of your own (GPS, landmarks, loop closures of another kind) before optimising. A link is
a max-mixture (Olson, Agarwal 2013): at each linearization the component that explains the headings
best, or that nothing is known. GTSAM calls back into Python for each of them, which is slow:
`optimize_graph` is what pflut itself uses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pflut._extras import require
from pflut.geometry import FloatArray
from pflut.mapping.graph_residuals import headings
from pflut.mapping.graph_system import GraphSystem
from pflut.mapping.pose_graph import PoseGraph

FIXED = 1e-6
"""Metres and radians: how exactly the fixed node is known."""


def gtsam_graph(
    graph: PoseGraph, *, heading_noise: float = 0.01, position_noise: float = 0.01
) -> tuple[Any, Any]:
    """Make a factor graph of a pose graph.

    Parameters
    ----------
    graph : PoseGraph
        The noise of its links goes with the distances of its nodes as they are.
    heading_noise, position_noise : float
        See `optimize_graph`.

    Returns
    -------
    factors : gtsam.NonlinearFactorGraph
        Its error is the cost of `optimize_graph` with ``loss="max-mixture"``, but for a constant.
    values : gtsam.Values
        The nodes as they are; their keys are the graph's ids.

    Raises
    ------
    ImportError
        If GTSAM is not installed.
    """
    gtsam = _gtsam()
    system = GraphSystem(graph, "max-mixture", heading_noise, position_noise)
    values = gtsam.Values()
    keys = graph.ids.tolist()
    for key, pose in zip(keys, graph.poses.tolist(), strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    factors = gtsam.NonlinearFactorGraph()
    known = gtsam.noiseModel.Isotropic.Sigma(3, FIXED)
    start = gtsam.Pose2(*graph.poses[graph.fixed].tolist())
    factors.add(gtsam.PriorFactorPose2(keys[graph.fixed], start, known))
    for (before, after), motion, information in zip(
        graph.odometry_nodes.tolist(), graph.odometry, graph.odometry_information, strict=True
    ):
        noise = gtsam.noiseModel.Gaussian.Information(information)
        between = gtsam.Pose2(*motion.tolist())
        factors.add(gtsam.BetweenFactorPose2(keys[before], keys[after], between, noise))
    unit = gtsam.noiseModel.Unit.Create(3)
    for link, ends in enumerate(graph.links.indices.tolist()):
        chosen = np.flatnonzero(system.terms.link == link)
        if len(chosen):
            factors.add(gtsam.CustomFactor(unit, ends, _error(gtsam, system, link, chosen)))
    return factors, values


def poses_of(values: Any, graph: PoseGraph) -> FloatArray:
    """Give the poses in GTSAM's values, in the order of a graph's nodes, (n, 3)."""
    poses = [values.atPose2(key) for key in graph.ids.tolist()]
    return np.array([[pose.x(), pose.y(), pose.theta()] for pose in poses])


def _error(gtsam: Any, system: GraphSystem, link: int, chosen: Any) -> Any:
    """Make the error function of a link.

    Three numbers: the best component's two residuals, and what turns its constant into a square.
    """
    terms = system.terms.select(chosen)
    whitening, constant = system.whitening[chosen], system.constant[chosen]
    null = float(system.terms.null[link])
    least = min(float(constant.min()), null)
    ends = np.array([[0, 1]])

    def error(this: Any, values: Any, jacobians: Any) -> FloatArray:
        left, right = map(values.atPose2, this.keys())
        poses = np.array([[p.x(), p.y(), p.theta()] for p in (left, right)])
        angles, slopes = headings(poses, ends)
        energies = terms.energies(angles, whitening, constant)
        best = int(np.argmin(energies))
        residual, jacobian = np.zeros(3), np.zeros((3, 6))
        if energies[best] < null:
            found, found_slopes = terms.residuals(angles, slopes, whitening)
            residual[:2], jacobian[:2] = found[best], found_slopes[best]
            residual[2] = np.sqrt(2.0 * (constant[best] - least))
        else:
            residual[2] = np.sqrt(2.0 * (null - least))
        if jacobians is not None:
            for side in range(2):
                # GTSAM moves a pose along its own axes
                cos, sin = np.cos(poses[side, 2]), np.sin(poses[side, 2])
                own = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
                jacobians[side] = jacobian[:, 3 * side : 3 * side + 3] @ own
        return residual

    return error


def _gtsam() -> Any:
    return require("gtsam", extra="gtsam", what="gtsam_graph")
