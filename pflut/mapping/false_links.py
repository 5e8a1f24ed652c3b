"""Links that are not: what perceptual aliasing does to a map, for experiments."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.geometry import FloatArray, as_poses
from pflut.mapping.constraint import PoseConstraint
from pflut.mapping.links import LINKED, Links
from pflut.von_mises.mixture import VonMisesMixture

FalseKind = Literal["random", "pair", "place"]
FAR = 3.0
"""Metres between images that a false link joins, at least."""
PLACE = 6
"""Links of one place that is taken for another."""
TRIES = 20
"""For each link that is wanted, before it is said that there are not so many."""


def with_false_links(
    links: Links,
    ground_truth: ArrayLike,
    share: float,
    kind: FalseKind = "random",
    *,
    rng: np.random.Generator | int | None = None,
) -> Links:
    """Add false links, as probable and as sure as the true ones.

    Parameters
    ----------
    links : Links
        Of a drive.
    ground_truth : array_like of shape (n, 3)
        Where its images were taken.
    share : float
        Of false ones among all links with a probability of a half or more, in [0, 1).
    kind : {"random", "pair", "place"}
        What a false link says. "random": what another link says, both headings turned at random.
        "pair": just what another link says. "place": an image b is taken for another image a,
        and gets the links that a has to six other images, which agree with each other.
    rng : Generator, int or None

    Returns
    -------
    Links
        The given ones, but those that a false one takes the place of, and the false ones at the
        end.

    Raises
    ------
    ValueError
        If the share or the kind is none, or fewer images are 3 m apart than the share asks for.
    """
    if not 0.0 <= share < 1.0:
        raise ValueError(f"share: expected a number in [0, 1), got {share}")
    if kind not in ("random", "pair", "place"):
        raise ValueError(f"kind: expected random, pair or place, got {kind!r}")
    generator = np.random.default_rng(rng)
    probable = np.flatnonzero((links.probability >= LINKED) & links.says_something)
    wanted = round(len(probable) * share / (1.0 - share))
    if not wanted:
        return links
    poses = as_poses(ground_truth, "ground_truth")
    offsets = poses[:, None, :2] - poses[None, :, :2]
    far = np.hypot(offsets[..., 0], offsets[..., 1]) >= FAR
    there = int(np.triu(far).sum())
    if there < wanted:
        raise ValueError(
            f"ground_truth: expected {wanted} pairs of images {FAR:g} m apart, got {there}"
        )
    made: dict[tuple[int, int], tuple[int, PoseConstraint]] = {}
    for _ in range(TRIES * wanted):
        if len(made) == wanted:
            break
        for pair, source, constraint in _some(links, probable, far, kind, generator):
            if len(made) < wanted:
                made[pair] = (source, constraint)
    if len(made) < wanted:
        raise ValueError(
            f"share: expected one that asks for no more false links than there are, got {share}: "
            f"{wanted} wanted, {len(made)} of the kind {kind!r} found"
        )
    pairs = np.array(list(made), dtype=np.int64)
    sources = np.array([source for source, _ in made.values()])
    false = Links.of(
        pairs,
        links.num_matches[sources],
        links.log_evidence[sources],
        links.probability[sources],
        [constraint for _, constraint in made.values()],
    )
    replaced = np.array([tuple(pair) in made for pair in links.indices.tolist()])
    return Links.concatenate([links[~replaced], false])


def _some(
    links: Links,
    probable: NDArray[np.intp],
    far: NDArray[np.bool_],
    kind: FalseKind,
    rng: np.random.Generator,
) -> list[tuple[tuple[int, int], int, PoseConstraint]]:
    """Make one false link, or those of one place."""
    source = int(rng.choice(probable))
    if kind != "place":
        left, right = np.argwhere(np.triu(far))[rng.integers(np.triu(far).sum())].tolist()
        turns = rng.uniform(-np.pi, np.pi, 2) if kind == "random" else np.zeros(2)
        return [((left, right), source, _turned(links.constraint(source), turns))]
    a = int(rng.choice(links.indices[source]))
    b = int(rng.choice(np.flatnonzero(far[a]))) if far[a].any() else a
    of_a = probable[(links.indices[probable] == a).any(axis=1)]
    found = []
    for link in rng.permutation(of_a)[:PLACE].tolist():
        left, right = links.indices[link].tolist()
        other = right if left == a else left
        if not far[b, other]:
            continue
        constraint = links.constraint(link)
        # L is the smaller index: b may stand on the other side than a did
        if (b < other) != (a < other):
            constraint = _exchanged(constraint)
        found.append(((min(b, other), max(b, other)), link, constraint))
    return found


def _turned(constraint: PoseConstraint, turns: FloatArray) -> PoseConstraint:
    """Add angles to both headings of a constraint."""
    old = constraint.mixture
    mixture = VonMisesMixture(
        old.weights,
        old.means + turns,
        old.concentrations,
        old.couplings,
        old.rotation_weights,
        old.rotation_means + turns[0] - turns[1],
        old.rotation_concentrations,
        old.uniform_weight,
        old.rotation_headings + turns[0],
        old.rotation_heading_concentrations,
    )
    return PoseConstraint(constraint.kind, mixture, constraint.entropy, constraint.divergence)


def _exchanged(constraint: PoseConstraint) -> PoseConstraint:
    """Exchange the views L and R."""
    old = constraint.mixture
    mixture = VonMisesMixture(
        old.weights,
        old.means[:, ::-1],
        old.concentrations[:, ::-1],
        old.couplings,
        old.rotation_weights,
        -old.rotation_means,
        old.rotation_concentrations,
        old.uniform_weight,
        old.rotation_headings - old.rotation_means + np.pi,
        old.rotation_heading_concentrations,
    )
    return PoseConstraint(constraint.kind, mixture, constraint.entropy, constraint.divergence)
