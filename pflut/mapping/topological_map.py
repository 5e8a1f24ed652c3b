"""A topological map: images as nodes, probable links as edges, places as communities of nodes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray, rotation_from_headings
from pflut.mapping.constraint import KINDS
from pflut.mapping.graphml import (
    FORMAT,
    as_graph,
    import_networkx,
    read_graphml,
    write_graphml,
)
from pflut.mapping.links import LINKED, Links

if TYPE_CHECKING:
    import networkx

HOP = 0.01
"""Cost of a link in a path, besides minus the log of its probability: of sure ways the shorter."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TopologicalMap:
    """Images, N of them, and the m links between them that are probable enough.

    It knows no distances, and needs no poses: from an image it says which others show the same
    place, and in which direction they were taken.

    Parameters
    ----------
    places : array_like of shape (N,), int
        The place of each image, numbers from 0.
    edges : array_like of shape (m, 2), int
        The images of each link, the smaller index first.
    probability : array_like of shape (m,)
        Of the links, in (0, 1].
    headings : array_like of shape (m, 2)
        ``[heading_l, heading_r]``, as of a pair: the direction to the other image in the robot's
        frame at the first, L, and at the second, R; radians, NaN where it is not known.
    rotation : array_like of shape (m,)
        Heading at R minus that at L, radians; NaN where it is not known.
    names : sequence of N str, optional
        Of the images. Default: their numbers.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a value is out of its range.
    """

    places: NDArray[np.int64]
    edges: NDArray[np.int64]
    probability: FloatArray
    headings: FloatArray
    rotation: FloatArray
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("places", "edges"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.int64))
        for name in ("probability", "headings", "rotation"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.float64))
        n, m = np.size(self.places), np.size(self.probability)
        names = tuple(map(str, self.names)) or tuple(map(str, range(n)))
        object.__setattr__(self, "names", names)
        shapes = {"places": (n,), "edges": (m, 2), "probability": (m,), "rotation": (m,)}
        for name, shape in (shapes | {"headings": (m, 2)}).items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {getattr(self, name).shape}")
        if not n:
            raise ValueError("places: expected those of at least one image, got none")
        if len(names) != n:
            raise ValueError(f"names: expected {n}, one an image, got {len(names)}")
        if set(self.places.tolist()) != set(range(int(self.places.max()) + 1)):
            raise ValueError("places: expected all numbers from 0 on")
        if m and (
            self.edges.min() < 0 or self.edges.max() >= n or (np.diff(self.edges) <= 0).any()
        ):
            raise ValueError(f"edges: expected two of {n} images, the smaller index first")
        if len(np.unique(self.edges, axis=0)) < m:
            raise ValueError("edges: expected each link once")
        if not ((self.probability > 0.0) & (self.probability <= 1.0)).all():
            raise ValueError("probability: expected numbers in (0, 1]")
        if np.isinf(self.headings).any() or np.isinf(self.rotation).any():
            raise ValueError("headings, rotation: expected radians, or NaN where not known")

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.places)

    @property
    def num_places(self) -> int:
        """How many places there are."""
        return int(self.places.max()) + 1

    @classmethod
    def from_links(
        cls,
        links: Links,
        num_images: int,
        *,
        min_probability: float = LINKED,
        resolution: float = 1.0,
        names: Sequence[str] = (),
        rng: np.random.Generator | int = 0,
    ) -> TopologicalMap:
        """Make a map of links, and find its places.

        Places are communities: images that are linked with each other more than with the rest, by
        Louvain's method on the links' probabilities. The largest is number 0. An image without a
        link is a place of its own.

        Parameters
        ----------
        links : Links
        num_images : int
        min_probability : float
            In (0, 1): less probable links are left out.
        resolution : float
            Positive: more makes smaller places.
        names : sequence of str, optional
            Of the images.
        rng : numpy.random.Generator or int
            Louvain's method visits the images in a random order.

        Returns
        -------
        TopologicalMap

        Raises
        ------
        ValueError
            If an option is out of its range, or a link is of an image beyond the last one.
        ImportError
            If networkx is not installed.

        References
        ----------
        Blondel, Guillaume, Lambiotte, Lefebvre, "Fast unfolding of communities in large networks"
        (2008).
        """
        if not 0.0 < min_probability < 1.0:
            raise ValueError(f"min_probability: expected in (0, 1), got {min_probability}")
        if not 0.0 < resolution < np.inf:
            raise ValueError(f"resolution: expected a positive number, got {resolution}")
        if len(links) and links.indices.max() >= num_images:
            raise ValueError(f"num_images: {num_images}, but image {links.indices.max()} is linked")
        probable = links[links.probability >= min_probability].ordered()
        headings, rotation = _directions(probable)
        alone = cls(
            places=np.arange(num_images),
            edges=probable.indices,
            probability=probable.probability,
            headings=headings,
            rotation=rotation,
            names=tuple(names),
        )
        return alone.with_places(resolution=resolution, rng=rng)

    def with_places(
        self, *, resolution: float = 1.0, rng: np.random.Generator | int = 0
    ) -> TopologicalMap:
        """Return the same map with places found anew, see `from_links`."""
        found = import_networkx().community.louvain_communities(
            self.to_networkx(), weight="probability", resolution=resolution, seed=rng
        )
        places = np.empty(len(self), np.int64)
        for place, members in enumerate(sorted(found, key=lambda those: (-len(those), min(those)))):
            places[list(members)] = place
        return replace(self, places=places)

    def members(self, place: int) -> NDArray[np.intp]:
        """Give the images of a place, in their order."""
        return np.flatnonzero(self.places == place)

    def neighbours(self, image: int) -> NDArray[np.int64]:
        """Give the images that an image is linked with, the most probable first.

        Parameters
        ----------
        image : int

        Returns
        -------
        ndarray of shape (k,), int
        """
        rows = np.flatnonzero((self.edges == self._checked(image)).any(axis=1))
        others: NDArray[np.int64] = self.edges[rows].sum(axis=1) - image
        return np.asarray(others[np.argsort(-self.probability[rows], kind="stable")])

    def heading(self, image: int, neighbour: int) -> float:
        """Say in which direction a neighbour of an image was taken.

        Parameters
        ----------
        image, neighbour : int

        Returns
        -------
        float
            Radians in the robot's frame at the image; NaN where the link does not tell, as that of
            two images taken at the same spot.

        Raises
        ------
        ValueError
            If the two are not linked.
        """
        pair = sorted((self._checked(image), self._checked(neighbour)))
        rows = np.flatnonzero((self.edges == pair).all(axis=1))
        if not len(rows):
            raise ValueError(f"images {image} and {neighbour} are not linked")
        return float(self.headings[rows[0], int(image > neighbour)])

    def shortest_path(self, start: int, goal: int) -> list[int]:
        """Give the most probable way from one image to another along links.

        Parameters
        ----------
        start, goal : int

        Returns
        -------
        list of int
            Images, the two among them; empty where there is no way. The product of the links'
            probabilities is largest, and of ways that are all but sure there are few links.
        """
        networkx = import_networkx()
        graph = self.to_networkx()
        try:
            path: list[int] = networkx.dijkstra_path(
                graph,
                self._checked(start),
                self._checked(goal),
                weight=lambda a, b, link: HOP - np.log(link["probability"]),
            )
        except networkx.NetworkXNoPath:
            return []
        return path

    def to_networkx(self) -> networkx.Graph:
        """Give the map as a graph of networkx, for what its many algorithms can say.

        Returns
        -------
        networkx.Graph
            Nodes with ``name`` and ``place``; edges with ``probability`` and, where they are known,
            ``heading_l`` and ``heading_r`` (at the image with the smaller and the larger number)
            and ``rotation``.

        Raises
        ------
        ImportError
            If networkx is not installed.
        """
        return as_graph(self)

    def layout(self, *, rng: np.random.Generator | int = 0) -> FloatArray:
        """Place the images for drawing where nothing is known of their poses.

        Parameters
        ----------
        rng : numpy.random.Generator or int
            The same seed gives the same picture.

        Returns
        -------
        ndarray of shape (N, 2)
            Linked images near each other; without a unit, and no map of the world.

        Raises
        ------
        ImportError
            If networkx or SciPy is not installed.
        """
        found = import_networkx().spring_layout(self.to_networkx(), weight="probability", seed=rng)
        return np.array([found[image] for image in range(len(self))], dtype=np.float64)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to a GraphML file, atomically.

        Programs that draw and explore graphs read GraphML (Gephi, Cytoscape, yEd, igraph), with
        names and types of what is known of nodes and edges; networkx' own JSON only networkx reads.

        Parameters
        ----------
        path : path
        """
        write_graphml(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TopologicalMap:
        """Read what `save` wrote.

        Parameters
        ----------
        path : path

        Returns
        -------
        TopologicalMap

        Raises
        ------
        ValueError
            If the file is none, of another version, or damaged.
        FileNotFoundError
            If there is no such file.
        ImportError
            If networkx is not installed.
        """
        columns = read_graphml(path)
        try:
            return cls(**columns)
        except ValueError as error:
            raise ValueError(f"{path}: damaged {FORMAT}: {error}") from error

    def _checked(self, image: int) -> int:
        if not 0 <= image < len(self):
            raise ValueError(f"image: expected 0 to {len(self) - 1}, got {image}")
        return int(image)


def _directions(links: Links) -> tuple[FloatArray, FloatArray]:
    """Give the headings and the rotations that the constraints of links name, NaN for the others.

    Of two opposite headings none is named. Where the headings are, the rotation is theirs: that of
    the whole mixture may be another mode's.
    """
    headings, rotation = np.full((len(links), 2), np.nan), np.full(len(links), np.nan)
    for link, kind in enumerate(links.kind):
        if KINDS[kind] == "none":
            continue
        constraint = links.constraint(link)
        if KINDS[kind] == "pose" and len(constraint.mixture.weights):
            headings[link] = constraint.mixture.merged_modes()[1][0]
            rotation[link] = rotation_from_headings(*headings[link])
        else:
            rotation[link] = constraint.rotation().mean
    return headings, rotation
