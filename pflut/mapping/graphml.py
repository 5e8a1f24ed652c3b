"""Topological maps as graphs of networkx, and as GraphML files."""

from __future__ import annotations

import os
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from pflut._extras import require
from pflut._files import replacing

if TYPE_CHECKING:
    import networkx

    from pflut.mapping.topological_map import TopologicalMap

FORMAT = "pflut topological map"
VERSION = 1
ANGLES = ("heading_l", "heading_r", "rotation")


def as_graph(topological_map: TopologicalMap) -> networkx.Graph:
    """Make a graph, see `TopologicalMap.to_networkx`."""
    graph = import_networkx().Graph(format=FORMAT, version=VERSION)
    nodes = zip(topological_map.names, topological_map.places.tolist(), strict=True)
    for image, (name, place) in enumerate(nodes):
        graph.add_node(image, name=name, place=place)
    known = np.column_stack([topological_map.headings, topological_map.rotation])
    for (left, right), probability, angles in zip(
        topological_map.edges.tolist(),
        topological_map.probability.tolist(),
        known.tolist(),
        strict=True,
    ):
        named = zip(ANGLES, angles, strict=True)
        about = {name: angle for name, angle in named if not np.isnan(angle)}
        graph.add_edge(left, right, probability=probability, **about)
    return graph


def write_graphml(path: str | os.PathLike[str], topological_map: TopologicalMap) -> None:
    """Write a map, see `TopologicalMap.save`."""
    networkx, graph = import_networkx(), as_graph(topological_map)
    with replacing(path) as temporary, temporary.open("wb") as file:
        # that of the standard library, whether or not another XML library is installed
        networkx.write_graphml_xml(graph, file)


def read_graphml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what `write_graphml` wrote.

    Parameters
    ----------
    path : path

    Returns
    -------
    dict
        What `TopologicalMap` is made of.

    Raises
    ------
    ValueError
        If the file is none, of another version, or damaged.
    FileNotFoundError
        If there is no such file.
    ImportError
        If networkx is not installed.
    """
    networkx = import_networkx()
    try:
        with Path(path).open("rb") as file:
            graph = networkx.read_graphml(file, node_type=int)
    except (SyntaxError, ValueError, KeyError, TypeError, networkx.NetworkXError) as error:
        raise ValueError(f"{path}: no GraphML, or damaged: {error}") from None
    if graph.graph.get("format") != FORMAT:
        raise ValueError(f"{path}: not a {FORMAT}")
    version = graph.graph.get("version")
    if version != VERSION:
        raise ValueError(f"{path}: topological map version {version}, expected {VERSION}")
    try:
        return _columns(graph)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: damaged {FORMAT}: {error}") from error


def import_networkx() -> ModuleType:
    """Import networkx, or say what is missing."""
    return require("networkx", extra="mapping", what="topological map")


def _columns(graph: networkx.Graph) -> dict[str, Any]:
    """Read the attributes of nodes and edges."""
    nodes = sorted(graph.nodes)
    if nodes != list(range(len(nodes))):
        raise ValueError(f"expected nodes 0 to {len(nodes) - 1}")
    rows: list[tuple[int, int, dict[str, Any]]] = sorted(
        (min(a, b), max(a, b), about) for a, b, about in graph.edges(data=True)
    )
    angles = np.array(
        [[about.get(name, np.nan) for name in ANGLES] for *_, about in rows], np.float64
    ).reshape(-1, len(ANGLES))
    return {
        "places": np.array([graph.nodes[node]["place"] for node in nodes]),
        "edges": np.array([row[:2] for row in rows], np.int64).reshape(-1, 2),
        "probability": np.array([about["probability"] for *_, about in rows], np.float64),
        "headings": angles[:, :2],
        "rotation": angles[:, 2],
        "names": tuple(graph.nodes[node]["name"] for node in nodes),
    }
