"""False links for experiments: as many, as far, as sure as they are said to be."""

from __future__ import annotations

import numpy as np
import pytest
from graphs import CONCENTRATION, links_of, loop, simulated_graph

from pflut.geometry import relative_headings, wrap_to_pi
from pflut.mapping.false_links import FAR, with_false_links
from pflut.mapping.links import Links
from pflut.von_mises.mixture import VonMisesMixture

TRUTH = loop(48) * [2.0, 2.0, 1.0]


def true_links() -> Links:
    return simulated_graph(TRUTH, None).links


@pytest.mark.parametrize("kind", ["random", "pair", "place"])
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_their_share_and_their_distance(kind: str, share: float) -> None:
    links = true_links()
    mixed = with_false_links(links, TRUTH, share, kind, rng=0)
    count = round(len(links) * share / (1.0 - share))
    false = mixed[-count:]
    assert len(mixed) == len(links) + count and len(np.unique(mixed.indices, axis=0)) == len(mixed)
    distance = np.hypot(*(TRUTH[false.indices[:, 0]] - TRUTH[false.indices[:, 1]])[:, :2].T)
    assert (distance >= FAR).all()
    assert (false.probability == 0.9).all() and (false.concentrations == CONCENTRATION).all()
    theta, phi, _ = relative_headings(TRUTH[false.indices[:, 0]], TRUTH[false.indices[:, 1]])
    wrong = np.abs(wrap_to_pi(false.means - np.stack([theta, phi], axis=1))).max(axis=1)
    assert np.median(wrong) > 0.3
    np.testing.assert_array_equal(
        with_false_links(links, TRUTH, share, kind, rng=0).means, mixed.means
    )


def test_what_another_pair_says_is_not_changed() -> None:
    links = true_links()
    false = with_false_links(links, TRUTH, 0.3, "pair", rng=1)[len(links) :]
    known = set(map(tuple, links.means.tolist()))
    assert all(tuple(mean) in known for mean in false.means.tolist())


def test_a_place_is_taken_for_another_as_a_whole() -> None:
    links = true_links()
    false = with_false_links(links, TRUTH, 0.1, "place", rng=2)[len(links) :]
    # those of one image agree on where it is: at the pose of the one that it is taken for
    image = int(np.bincount(false.indices.ravel()).argmax())
    of_image = np.flatnonzero((false.indices == image).any(axis=1))
    explained = np.zeros((len(TRUTH), len(of_image)), bool)
    for other in range(len(TRUTH)):
        poses = TRUTH.copy()
        poses[image] = TRUTH[other]
        for k, link in enumerate(of_image):
            left, right = false.indices[link]
            theta, phi, _ = relative_headings(poses[left], poses[right])
            error = wrap_to_pi(false.means[link] - [theta, phi])
            explained[other, k] = np.abs(error).max() < 1e-6
    assert explained.sum(axis=1).max() >= min(3, len(of_image))


def test_bands_are_turned_and_exchanged_too() -> None:
    band = VonMisesMixture(
        rotation_weights=np.ones(1),
        rotation_means=np.array([0.7]),
        rotation_concentrations=np.array([50.0]),
    )
    pairs = true_links().indices
    links = links_of(pairs, [band] * len(pairs))
    for kind in ("random", "pair", "place"):
        false = with_false_links(links, TRUTH, 0.2, kind, rng=3)[-20:]
        sizes = np.abs(false.rotation_means)
        assert np.allclose(sizes, 0.7) == (kind != "random")


def test_none_are_added_and_wrong_ones_are_refused() -> None:
    links = true_links()
    assert with_false_links(links, TRUTH, 0.0) is links
    with pytest.raises(ValueError, match=r"share: expected a number in \[0, 1\), got 1.0"):
        with_false_links(links, TRUTH, 1.0)
    with pytest.raises(ValueError, match="kind: expected random, pair or place, got 'worst'"):
        with_false_links(links, TRUTH, 0.1, "worst")


@pytest.mark.parametrize("kind", ["random", "pair", "place"])
def test_more_than_there_are_are_refused_and_not_looked_for_without_end(kind: str) -> None:
    links = true_links()
    near = TRUTH * [0.1, 0.1, 1.0]
    with pytest.raises(ValueError, match="pairs of images 3 m apart, got 0"):
        with_false_links(links, near, 0.1, kind)
    there = len(with_false_links(links, TRUTH, 0.5, kind, rng=0)) - len(links)
    assert there == len(links)
    with pytest.raises(ValueError, match="pairs of images 3 m apart, got"):
        with_false_links(links, TRUTH, 0.99, kind)


def test_places_that_run_out_are_refused() -> None:
    # one link: another place can be linked with its two images only
    poses = loop(12) * [4.0, 4.0, 1.0]
    pair = simulated_graph(loop(12), None).links[:1]
    with pytest.raises(ValueError, match=r"than there are, got 0.96: 24 wanted, [0-9]+ of the"):
        with_false_links(pair, poses, 0.96, "place", rng=0)
