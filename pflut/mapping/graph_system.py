"""The least-squares problem of a pose graph: its cost, its steps and its covariances."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from pflut._extras import require
from pflut.geometry import FloatArray
from pflut.mapping.graph_residuals import MIN_DISTANCE, headings, odometry_residuals
from pflut.mapping.link_terms import LinkTerms
from pflut.mapping.links import LINKED
from pflut.mapping.pose_graph import IndexArray, PoseGraph

Loss = Literal["mixture", "max-mixture", "gaussian", "huber", "cauchy"]
HUBER, CAUCHY = 1.345, 2.385
"""Of the kernels, in standard deviations: 95 % efficient with normal noise."""
MAX_STEPS = 25
TOLERANCE = 1e-6
"""Of the cost, relative: a smaller gain ends a descent."""
FAINT = 1e-6
"""A component with a smaller share is left out of the linear system."""
BLOCK = 64
"""Nodes whose covariances are solved for at once."""


class GraphSystem:
    """The cost of a pose graph as a function of its poses, and how to make it less.

    Parameters
    ----------
    graph : PoseGraph
    loss : {"mixture", "max-mixture", "gaussian", "huber", "cauchy"}
    heading_noise, position_noise : float
        See `optimize_graph`.
    """

    def __init__(
        self, graph: PoseGraph, loss: Loss, heading_noise: float, position_noise: float
    ) -> None:
        self.graph = graph
        self.loss = loss
        self.heading_noise = heading_noise
        self.position_noise = position_noise
        self.nodes = graph.link_nodes
        self.terms = LinkTerms.of(graph.links)
        self.free = np.delete(np.arange(3 * len(graph)), np.arange(3) + 3 * graph.fixed)
        self._odometry = np.linalg.cholesky(graph.odometry_information).transpose(0, 2, 1)
        self._believed = self._heaviest() if loss in ("gaussian", "huber", "cauchy") else None
        self.set_noise(graph.poses)

    def set_noise(self, poses: FloatArray, predicted: FloatArray | None = None) -> None:
        """Give the links the noise that goes with the distances of their nodes.

        Parameters
        ----------
        poses : ndarray of shape (n, 3)
        predicted : ndarray of shape (m, 2, 2), optional
            Covariance of the headings' prediction, added.
        """
        ends = poses[self.nodes, :2]
        distance = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        direction = (self.position_noise / np.maximum(distance, MIN_DISTANCE)) ** 2
        noise = direction[:, None, None] * np.ones((2, 2)) + self.heading_noise**2 * np.eye(2)
        self.whitening, self.constant = self.terms.whitened(
            noise if predicted is None else noise + predicted
        )

    def shares(self, poses: FloatArray) -> tuple[FloatArray, float]:
        """Give the weights of the links' components in the next step, and the cost.

        Parameters
        ----------
        poses : ndarray of shape (n, 3)

        Returns
        -------
        shares : ndarray of shape (c,)
        cost : float
            Nats.
        """
        values, _ = headings(poses, self.nodes)
        residuals, _ = odometry_residuals(poses, self.graph.odometry_nodes, self.graph.odometry)
        whitened = np.einsum("kij,kj->ki", self._odometry, residuals)
        cost = 0.5 * float((whitened**2).sum())
        energies = self.terms.energies(values, self.whitening, self.constant)
        if self._believed is not None:
            shares, energy = self._kernel(energies - self.constant)
        elif self.loss == "mixture":
            shares, energy = self.terms.shares(energies)
        else:
            energy = self.terms.lowest(energies)
            shares = (energies <= energy[self.terms.link]).astype(np.float64)
        return shares, cost + float(energy.sum())

    def descend(
        self, poses: FloatArray, shares: FloatArray | None = None
    ) -> tuple[FloatArray, int]:
        """Move the nodes until the cost is least.

        Parameters
        ----------
        poses : ndarray of shape (n, 3)
        shares : ndarray of shape (c,), optional
            Weights of the components, kept. Default: those of the cost itself, anew at each step.

        Returns
        -------
        poses : ndarray of shape (n, 3)
        steps : int
            Linear systems solved.
        """
        damping, steps = 1e-4, 0
        weights, cost = self._weighed(poses, shares)
        while steps < MAX_STEPS:
            residuals, jacobian = self.linearized(poses, weights)
            normal, slope = jacobian.T @ jacobian, jacobian.T @ residuals
            while True:
                moved = poses.copy()
                moved.ravel()[self.free] -= _solved(normal, slope, damping)
                steps += 1
                new_weights, new_cost = self._weighed(moved, shares)
                if new_cost <= cost or steps >= MAX_STEPS:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not new_cost <= cost:
                break
            gain = cost - new_cost
            poses, weights, cost = moved, new_weights, new_cost
            damping = max(0.2 * damping, 1e-10)
            if gain <= TOLERANCE * max(abs(cost), 1.0):
                break
        return poses, steps

    def linearized(self, poses: FloatArray, shares: FloatArray) -> tuple[FloatArray, Any]:
        """Give the weighted residuals and their Jacobian.

        Parameters
        ----------
        poses : ndarray of shape (n, 3)
        shares : ndarray of shape (c,)

        Returns
        -------
        residuals : ndarray of shape (r,)
        jacobian : scipy.sparse.csc_array of shape (r, 3 (n - 1))
            With respect to all poses but the fixed one.
        """
        sparse = _scipy_sparse()
        graph, terms = self.graph, self.terms
        values, slopes = odometry_residuals(poses, graph.odometry_nodes, graph.odometry)
        chosen = np.flatnonzero(shares > FAINT)
        ends, end_slopes = headings(poses, self.nodes)
        of_links, link_slopes = terms.residuals(ends, end_slopes, self.whitening, chosen)
        root = np.sqrt(shares[chosen])[:, None]
        residuals = np.concatenate(
            [
                np.einsum("kij,kj->ki", self._odometry, values).ravel(),
                (root * of_links).ravel(),
            ]
        )
        entries = np.concatenate(
            [
                (self._odometry @ slopes).reshape(-1, 6),
                (root[:, :, None] * link_slopes).reshape(-1, 6),
            ]
        )
        nodes = np.concatenate(
            [
                np.repeat(graph.odometry_nodes, 3, axis=0),
                np.repeat(self.nodes[terms.link[chosen]], 2, axis=0),
            ]
        )
        rows = np.repeat(np.arange(len(residuals)), 6)
        columns = (3 * nodes[:, :, None] + np.arange(3)).ravel()
        shape = (len(residuals), 3 * len(poses))
        jacobian = sparse.coo_array((entries.ravel(), (rows, columns)), shape=shape)
        return residuals, sparse.csc_array(jacobian)[:, self.free]

    def predicted(self, poses: FloatArray, shares: FloatArray) -> FloatArray:
        """Give the covariances of the headings between the nodes of each link, (m, 2, 2)."""
        _, jacobians = headings(poses, self.nodes)
        covariances = self.pair_covariances(poses, shares, self.nodes)
        return np.asarray(jacobians @ covariances @ jacobians.transpose(0, 2, 1))

    def pair_covariances(
        self, poses: FloatArray, shares: FloatArray, nodes: IndexArray
    ) -> FloatArray:
        """Give the covariances of pairs of nodes, relative to the fixed node.

        Parameters
        ----------
        poses : ndarray of shape (n, 3)
        shares : ndarray of shape (c,)
        nodes : ndarray of shape (m, 2), int

        Returns
        -------
        ndarray of shape (m, 6, 6)
            Of both nodes' ``[x, y, heading]``, metres and radians.
        """
        _, jacobian = self.linearized(poses, shares)
        factors = _factorized(jacobian.T @ jacobian, 0.0)
        n = len(poses)
        place = np.full(3 * n, -1)
        place[self.free] = np.arange(3 * n - 3)
        covariances = np.zeros((len(nodes), 6, 6))
        rows = 3 * nodes[:, :, None] + np.arange(3)
        for start in range(0, n, BLOCK):
            block = np.arange(start, min(start + BLOCK, n))
            columns = (3 * block[:, None] + np.arange(3)).ravel()
            inside = place[columns] >= 0
            right = np.zeros((3 * n - 3, len(columns)))
            right[place[columns][inside], np.flatnonzero(inside)] = 1.0
            solved = np.zeros((3 * n, len(columns)))
            solved[self.free] = factors.solve(right)
            for end in range(2):
                here = np.flatnonzero((nodes[:, end] >= start) & (nodes[:, end] <= block[-1]))
                at = 3 * (nodes[here, end] - start)[:, None] + np.arange(3)
                both = rows[here].reshape(-1, 6)
                part = solved[both[:, :, None], at[:, None, :]]
                covariances[here, :, 3 * end : 3 * end + 3] = part
        return covariances

    def _weighed(self, poses: FloatArray, shares: FloatArray | None) -> tuple[FloatArray, float]:
        """Give weights and the cost, of weights that are kept or the cost's own."""
        if shares is None:
            return self.shares(poses)
        residuals, _ = self.linearized(poses, shares)
        return shares, 0.5 * float(residuals @ residuals)

    def _heaviest(self) -> FloatArray:
        """Say which component is the heaviest of each link that tells one, and is probable."""
        terms, links = self.terms, self.graph.links
        best = np.full(len(terms.null), -np.inf)
        np.maximum.at(best, terms.link, terms.log_weight)
        probable = (links.probability >= LINKED) & links.says_something
        heaviest = (terms.log_weight >= best[terms.link]) & probable[terms.link]
        return heaviest.astype(np.float64)

    def _kernel(self, halves: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Give the weights and costs of half squared residuals under a kernel."""
        squared = 2.0 * halves
        if self.loss == "huber":
            size = np.sqrt(squared)
            inside = size <= HUBER
            weights = np.where(inside, 1.0, HUBER / np.maximum(size, HUBER))
            costs = np.where(inside, halves, HUBER * (size - 0.5 * HUBER))
        elif self.loss == "cauchy":
            weights = 1.0 / (1.0 + squared / CAUCHY**2)
            costs = 0.5 * CAUCHY**2 * np.log1p(squared / CAUCHY**2)
        else:
            weights, costs = np.ones_like(halves), halves
        return weights * self._believed, costs * self._believed


def _solved(normal: Any, slope: FloatArray, damping: float) -> FloatArray:
    """Solve the damped normal equations."""
    return np.asarray(_factorized(normal, damping).solve(slope))


def _factorized(normal: Any, damping: float) -> Any:
    sparse = _scipy_sparse()
    from scipy.sparse.linalg import splu

    diagonal = sparse.dia_array(((damping * normal.diagonal() + 1e-12)[None], [0]), normal.shape)
    # the ordering is for symmetric matrices
    return splu(sparse.csc_array(normal + diagonal), permc_spec="MMD_AT_PLUS_A")


def _scipy_sparse() -> Any:
    return require("scipy.sparse", extra="mapping", what="optimize_graph")
