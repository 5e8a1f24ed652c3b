"""Which pairs are worth matching."""

from __future__ import annotations

import numpy as np
import pytest
from world import World

from pflut.mapping.proposals import alike, all_of, image_signatures


def test_all_pairs_are_all() -> None:
    assert all_of(4).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]


@pytest.mark.parametrize(("candidates", "neighbours"), [(0, 1), (3, 0), (3, 2), (900, 0)])
def test_the_most_alike_are_proposed(candidates: int, neighbours: int) -> None:
    """Beside the plain loop over all images, more of them than are compared at a time."""
    rng = np.random.default_rng(0)
    signatures = rng.normal(size=(300, 8)).astype(np.float32)
    expected = set()
    for image in range(300):
        similar = signatures @ signatures[image]
        similar[image] = -np.inf
        chosen = [int(k) for k in np.argsort(-similar)[: min(candidates, 299)]]
        chosen += [k for k in range(image + 1, image + neighbours + 1) if k < 300]
        expected |= {(min(image, k), max(image, k)) for k in chosen}
    pairs = alike(signatures, candidates, neighbours=neighbours)
    assert pairs.tolist() == [list(pair) for pair in sorted(expected)]


def test_images_of_one_room_are_alike() -> None:
    rooms = [World(seed=0), World(seed=1)]
    looks = [rooms[k % 2].look(np.zeros(3), seed=k, seen=0.9, clutter=5) for k in range(10)]
    signatures = image_signatures(lambda image: looks[image].descriptors, 10)
    pairs = alike(signatures, 3, neighbours=0)
    assert len(pairs) >= 15 and (np.diff(pairs) % 2 == 0).all()


@pytest.mark.parametrize("dark", [range(32), range(0, 300, 3), range(300)])
def test_images_in_the_dark_are_like_no_other(dark: range) -> None:
    """A whole block of them has descriptors of no kind; so may have all that words are made of."""
    rng = np.random.default_rng(0)
    bits = rng.normal(size=(20, 16)).astype(np.float32)
    looks = {k: bits + rng.normal(0.0, 0.1, bits.shape).astype(np.float32) for k in range(300)}
    looks |= dict.fromkeys(dark, np.empty((0, 1), np.float32))
    signatures = image_signatures(lambda image: looks[image], 300)
    assert signatures.shape[0] == 300 and not signatures[list(dark)].any()
    lengths = np.linalg.norm(np.delete(signatures, list(dark), axis=0), axis=1)
    assert lengths == pytest.approx(np.ones(300 - len(dark)), abs=1e-5)


def test_proposals_of_less_than_none() -> None:
    for name in ("max_candidates", "neighbours"):
        with pytest.raises(ValueError, match=f"{name}: expected at least 0, got -1"):
            alike(np.zeros((3, 2), np.float32), **{"max_candidates": 1, name: -1})
