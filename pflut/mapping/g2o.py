"""Pose graphs as g2o files, that g2o itself, GTSAM's ``readG2o`` and others read.

Nodes are ``VERTEX_SE2``, odometry ``EDGE_SE2``, the fixed node ``FIX``. A link is a mixture over
two headings, which no other program knows: it has a tag of its own, which they pass over,

    EDGE_SE2_HEADINGS l r probability uniform kind
        modes (weight heading_l heading_r k_l k_r coupling) ...
        bands (weight rotation k_rotation heading_l k_heading_l) ...

on one line. For them it can be written as an ``EDGE_SE2`` as well, whose distance is that of the
nodes in the graph and is said to be unknown.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from pflut._files import read_text, write_text
from pflut.geometry import FloatArray, relative_headings, relative_pose
from pflut.mapping.constraint import KINDS, PoseConstraint
from pflut.mapping.link_terms import BROADEST, mode_covariances
from pflut.mapping.links import Links
from pflut.mapping.pose_graph import IndexArray, PoseGraph
from pflut.von_mises.mixture import VonMisesMixture

HEADINGS = "EDGE_SE2_HEADINGS"
_MODE, _BAND = 6, 5  # numbers
_UPPER = np.triu_indices(3)
WEAK = 1e-6
"""Information, per square metre, of the distance where only a rotation is known."""


def write_g2o(
    path: str | os.PathLike[str],
    graph: PoseGraph,
    *,
    mixtures: bool = True,
    edges: IndexArray | None = None,
) -> None:
    """Write a pose graph, atomically and with all digits.

    Parameters
    ----------
    path : path
    graph : PoseGraph
        With its nodes where they are to be written: optimised, as a rule.
    mixtures : bool
        Whether the links are written with their tag, which `read_g2o` reads and others skip.
    edges : ndarray of int, optional
        The links that are written as ``EDGE_SE2`` too, with the component that fits the nodes
        best; a program that has no mixtures should get no false ones. Default: none.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    """
    ids = graph.ids.tolist()
    lines = [
        f"VERTEX_SE2 {node} {_numbers(pose)}" for node, pose in zip(ids, graph.poses, strict=True)
    ]
    for (before, after), motion, information in zip(
        graph.odometry_nodes.tolist(), graph.odometry, graph.odometry_information, strict=True
    ):
        lines.append(_edge(ids[before], ids[after], motion, information))
    links = graph.links
    for link in range(len(links)) if mixtures else ():
        mixture = links.mixture(link)
        head = [links.probability[link], mixture.uniform_weight]
        modes = np.column_stack(
            [mixture.weights, mixture.means, mixture.concentrations, mixture.couplings]
        )
        bands = np.column_stack(
            [
                mixture.rotation_weights,
                mixture.rotation_means,
                mixture.rotation_concentrations,
                mixture.rotation_headings,
                mixture.rotation_heading_concentrations,
            ]
        )
        left, right = links.indices[link].tolist()
        words = [HEADINGS, str(left), str(right), _numbers(head), KINDS[links.kind[link]]]
        for part in (modes, bands):
            words += [str(len(part)), _numbers(part.ravel())]
        lines.append(" ".join(word for word in words if word))
    for link in [] if edges is None else np.asarray(edges).tolist():
        plain = as_pose_edge(graph, link)
        if plain is not None:
            left, right = links.indices[link].tolist()
            lines.append(_edge(left, right, *plain))
    # the last line: GTSAM reads nothing that comes after it
    lines.append(f"FIX {ids[graph.fixed]}")
    write_text(path, "\n".join(lines) + "\n")


def as_pose_edge(graph: PoseGraph, link: int) -> tuple[FloatArray, FloatArray] | None:
    """Turn a link into a relative pose with an information matrix.

    Parameters
    ----------
    graph : PoseGraph
        Its nodes give the distance, and choose among the components.
    link : int

    Returns
    -------
    motion : ndarray of shape (3,)
        Of R in L's frame, or None where the link holds nothing: it is of the kind "none", or has
        no component.
    information : ndarray of shape (3, 3)
        In the frame after the motion. A distance has a standard deviation as large as itself.
    """
    if not graph.links.says_something[link]:
        return None
    mixture = graph.links.mixture(link)
    left, right = graph.poses[graph.link_nodes[link]]
    theta, phi, distance = relative_headings(left, right)
    logs = mixture.component_log_densities(np.array([theta, phi]))[:-1]
    if not len(logs):
        return None
    best = int(np.argmax(logs))
    if best < len(mixture.weights):
        length = max(float(distance), 1e-3)
        heading_l, heading_r = mixture.means[best]
        turn = heading_l - heading_r + np.pi
        motion = np.array([length * np.cos(heading_l), length * np.sin(heading_l), turn])
        # of (distance, heading_l, heading_r), then of (x, y, heading) in the frame of L
        covariance = np.zeros((3, 3))
        covariance[0, 0] = length**2
        covariance[1:, 1:] = mode_covariances(mixture.concentrations, mixture.couplings)[best]
        cos, sin = np.cos(heading_l), np.sin(heading_l)
        to_left = np.array([[cos, -length * sin, 0], [sin, length * cos, 0], [0, 1.0, -1.0]])
        cos, sin = np.cos(turn), np.sin(turn)
        to_right = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]]) @ to_left
        information = np.linalg.inv(to_right @ covariance @ to_right.T)
        motion[2] = np.arctan2(sin, cos)
        return motion, 0.5 * (information + information.T)
    band = best - len(mixture.weights)
    motion = relative_pose(left, right)
    motion[2] = mixture.rotation_means[band]
    sharpness = max(float(mixture.rotation_concentrations[band]), BROADEST)
    return motion, np.diag([WEAK, WEAK, sharpness])


def read_g2o(path: str | os.PathLike[str]) -> PoseGraph:
    """Read a pose graph.

    Parameters
    ----------
    path : path
        Lines of ``VERTEX_SE2``, ``EDGE_SE2``, ``FIX`` and ``EDGE_SE2_HEADINGS``; ``#`` starts a
        comment. Every ``EDGE_SE2`` becomes odometry. Without ``FIX`` the first node is fixed.

    Returns
    -------
    PoseGraph
        Its links have neither matches nor evidence, and zeros instead.

    Raises
    ------
    ValueError
        Naming file and line: another tag, a number that is none or missing, an edge to a node that
        is not there, an information matrix that is not positive definite, two nodes of one id.
    """
    vertices: dict[int, list[float]] = {}
    edges: list[tuple[int, int, list[float]]] = []
    links: list[tuple[int, int, float, PoseConstraint]] = []
    fixed: list[int] = []
    used: list[tuple[str, int]] = []  # where, and which nodes
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        where = f"{path}:{number}"
        if not words or words[0].startswith("#"):
            continue
        tag, rest = words[0], words[1:]
        if tag == "VERTEX_SE2":
            (node,), values = _parse(where, rest, 1, 3)
            if node in vertices:
                raise ValueError(f"{where}: a second VERTEX_SE2 {node}")
            vertices[node] = values
        elif tag == "FIX":
            (node,), _ = _parse(where, rest, 1, 0)
            fixed.append(node)
            used.append((where, node))
        elif tag == "EDGE_SE2":
            (i, j), values = _parse(where, rest, 2, 9)
            if np.linalg.eigvalsh(_symmetric(values[3:]))[0] <= 0.0:
                raise ValueError(f"{where}: the information is not positive definite")
            edges.append((i, j, values))
            used += [(where, i), (where, j)]
        elif tag == HEADINGS:
            links.append(_parse_link(where, rest))
            used += [(where, links[-1][0]), (where, links[-1][1])]
        else:
            raise ValueError(
                f"{where}: tag {tag!r}, expected VERTEX_SE2, EDGE_SE2, FIX or {HEADINGS}"
            )
    if not vertices:
        raise ValueError(f"{path}: no VERTEX_SE2")
    for where, node in used:
        if node not in vertices:
            raise ValueError(f"{where}: no VERTEX_SE2 {node}")
    if len(set(fixed)) > 1:
        raise ValueError(f"{path}: {len(set(fixed))} nodes are fixed, expected one")
    ids = np.array(sorted(vertices), dtype=np.int64)
    place = {int(node): k for k, node in enumerate(ids)}
    return PoseGraph(
        np.array([vertices[int(node)] for node in ids]),
        np.array([[place[i], place[j]] for i, j, _ in edges], dtype=np.int64).reshape(-1, 2),
        np.array([values[:3] for *_, values in edges]).reshape(-1, 3),
        np.array([_symmetric(values[3:]) for *_, values in edges]).reshape(-1, 3, 3),
        Links.of(
            np.array([[i, j] for i, j, *_ in links], dtype=np.int64).reshape(-1, 2),
            [0] * len(links),
            [0.0] * len(links),
            [probability for _, _, probability, _ in links],
            [constraint for *_, constraint in links],
        ),
        ids,
        place[fixed[0]] if fixed else 0,
    )


def _edge(before: int, after: int, motion: FloatArray, information: FloatArray) -> str:
    return f"EDGE_SE2 {before} {after} {_numbers(motion)} {_numbers(information[_UPPER])}"


def _numbers(values: Any) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=np.float64).tolist()))


def _symmetric(upper: list[float]) -> FloatArray:
    matrix = np.zeros((3, 3))
    matrix[_UPPER] = upper
    return np.triu(matrix) + np.triu(matrix, 1).T


def _parse(where: str, words: list[str], nodes: int, numbers: int) -> tuple[list[int], list[float]]:
    """Give the ids and the numbers of a line, exactly so many."""
    if len(words) != nodes + numbers:
        raise ValueError(f"{where}: {len(words)} values, expected {nodes + numbers}")
    return _each(where, words[:nodes], int), _finite(where, words[nodes:])


def _each(where: str, words: list[str], kind: Callable[[str], Any]) -> list[Any]:
    try:
        values = [kind(word) for word in words]
    except ValueError:
        raise ValueError(f"{where}: not all numbers: {' '.join(words)}") from None
    return values


def _finite(where: str, words: list[str]) -> list[float]:
    values = _each(where, words, float)
    if not np.isfinite(values).all():
        raise ValueError(f"{where}: a value is not finite")
    return values


def _parse_link(where: str, words: list[str]) -> tuple[int, int, float, PoseConstraint]:
    """Read what stands after the tag of a link."""
    if len(words) < 6 or words[4] not in KINDS:
        raise ValueError(
            f"{where}: expected l r probability uniform kind modes ..., the kind one of "
            f"{', '.join(KINDS)}"
        )
    left, right = _each(where, words[:2], int)
    probability, uniform = _finite(where, words[2:4])
    rest, parts = words[5:], []
    for size in (_MODE, _BAND):
        count = _each(where, rest[:1], int)
        end = 1 + size * (count[0] if count else 0)
        if not count or count[0] < 0 or len(rest) < end:
            raise ValueError(f"{where}: fewer values than the numbers of modes and bands say")
        parts.append(np.array(_finite(where, rest[1:end])).reshape(-1, size))
        rest = rest[end:]
    if rest:
        raise ValueError(f"{where}: more values than the numbers of modes and bands say")
    modes, bands = parts
    if left >= right or not 0.0 <= probability <= 1.0:
        raise ValueError(f"{where}: expected l < r and a probability in [0, 1]")
    try:
        mixture = VonMisesMixture(
            weights=modes[:, 0],
            means=modes[:, 1:3],
            concentrations=modes[:, 3:5],
            couplings=modes[:, 5],
            rotation_weights=bands[:, 0],
            rotation_means=bands[:, 1],
            rotation_concentrations=bands[:, 2],
            uniform_weight=uniform,
            rotation_headings=bands[:, 3],
            rotation_heading_concentrations=bands[:, 4],
        )
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return left, right, probability, PoseConstraint(words[4], mixture, 0.0, 0.0)
