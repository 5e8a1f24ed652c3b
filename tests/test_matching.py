"""Matching and the removal of features that resemble each other, against naive twins."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from pflut.correspondences import Correspondences
from pflut.features import Features, match, match_indices, match_many
from pflut.features.distinct import distinct, unique_at_seam
from pflut.features.reference_matcher import ReferenceMatcher

# uint64 products wrap in the bit count; NumPy says so where NUMBA_DISABLE_JIT is set
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


def features(
    rng: np.random.Generator, n: int, *, binary: bool = False, base: Features | None = None
) -> Features:
    """Random features; with a base, noisy copies of its descriptors in random order."""
    if base is not None:
        picked = base.descriptors[rng.integers(0, len(base), n)]
        if binary:
            noise = rng.integers(0, 256, picked.shape) & rng.integers(0, 256, picked.shape)
            noise &= rng.integers(0, 256, picked.shape) & rng.integers(0, 256, picked.shape)
            descriptors = picked ^ noise.astype(np.uint8)
        else:
            descriptors = picked + rng.normal(0.0, 0.04, picked.shape)
    elif binary:
        descriptors = rng.integers(0, 256, (n, 32)).astype(np.uint8)
    else:
        descriptors = np.abs(rng.normal(size=(n, 128)))
    if not binary:
        descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
        descriptors = descriptors.astype(np.float32)
    return Features(
        rng.uniform(0.0, 2 * np.pi, n),
        rng.uniform(-0.5, 0.5, n),
        descriptors,
        rng.uniform(0.0, 500.0, (n, 2)),
        rng.uniform(0.0, 1.0, n),
    )


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("mutual", [False, True])
@pytest.mark.parametrize("ratio", [0.6, 0.8, 1.0])
def test_match_as_naive(binary: bool, mutual: bool, ratio: float) -> None:
    rng = np.random.default_rng(0)
    reference = features(rng, 60, binary=binary)
    query = features(rng, 80, binary=binary, base=reference)
    expected = naive.ratio_matches(reference.descriptors, query.descriptors, ratio, mutual)
    i, j, score = match_indices(reference, query, ratio=ratio, mutual=mutual)
    assert len(expected) > 20
    assert j.tolist() == sorted(expected)
    assert i.tolist() == [expected[k][0] for k in j]
    assert score == pytest.approx([expected[k][1] for k in j], abs=1e-5)
    assert len(set(i.tolist())) == i.size
    result = match(reference, query, ratio=ratio, mutual=mutual)
    assert np.array_equal(result.azimuth_l, reference.azimuth[i])
    assert np.array_equal(result.elevation_l, reference.elevation[i])
    assert np.array_equal(result.azimuth_r, query.azimuth[j])
    assert np.array_equal(result.elevation_r, query.elevation[j])
    assert np.array_equal(result.quality, score)


def test_lengths_of_descriptors_count() -> None:
    """Descriptors that are no unit vectors are compared by their true distance."""
    rng = np.random.default_rng(1)
    reference, query = features(rng, 40), features(rng, 50)
    stretched = [
        Features(
            f.azimuth,
            f.elevation,
            f.descriptors * rng.uniform(0.5, 2.0, (len(f), 1)).astype(np.float32),
            f.pixels,
            f.response,
        )
        for f in (reference, query)
    ]
    expected = naive.ratio_matches(stretched[0].descriptors, stretched[1].descriptors, 1.0, True)
    i, j, _ = match_indices(*stretched, ratio=1.0, mutual=True)
    assert j.tolist() == sorted(expected)
    assert i.tolist() == [expected[k][0] for k in j]


@pytest.mark.parametrize("binary", [False, True])
def test_many_references_are_each_one(binary: bool) -> None:
    rng = np.random.default_rng(2)
    first = features(rng, 50, binary=binary)
    query = features(rng, 70, binary=binary, base=first)
    empty = Features.empty(binary=binary)
    references = [first, empty, features(rng, 90, binary=binary), first[:1], first[:2]]
    many = match_many(references, query, ratio=0.9, mutual=True)
    assert [len(c) > 0 for c in many[:2]] == [True, False]
    assert len(many[3]) == 0  # one feature has no second-nearest
    for reference, got in zip(references, many, strict=True):
        one = match(reference, query, ratio=0.9, mutual=True)
        assert np.array_equal(got.azimuth_l, one.azimuth_l)
        assert np.array_equal(got.azimuth_r, one.azimuth_r)
        assert np.array_equal(got.quality, one.quality)
    assert [len(c) for c in match_many(references, empty)] == [0] * 5
    assert match_many([], query) == []
    assert isinstance(many[1], Correspondences)


def test_an_image_is_matched_with_a_reference_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    references = [features(rng, 30) for _ in range(4)]
    images = [features(rng, 40, base=references[k]) for k in (1, 2)]
    matcher = ReferenceMatcher(references, ratio=0.8, mutual=True)
    counts = []

    def counting(new: list[Features], query: Features, **options: object) -> list[Correspondences]:
        counts.append(len(new))
        return match_many(new, query, **options)

    monkeypatch.setattr("pflut.features.reference_matcher.match_many", counting)
    for image, indices in ((0, [2, 1]), (0, [1, 3, 2]), (1, [1]), (0, [1])):
        pairs = matcher(images[image], indices)
        expected = match_many([references[k] for k in indices], images[image], mutual=True)
        assert [p.azimuth_l.tolist() for p in pairs] == [p.azimuth_l.tolist() for p in expected]
        assert len(pairs[indices.index(1)]) > 5 or image == 1
    # of the last image only
    assert counts == [2, 1, 1, 1]
    with pytest.raises(ValueError, match=r"ratio: expected in \(0, 1\], got 1.1"):
        ReferenceMatcher(references, ratio=1.1, mutual=False)


def test_twins_in_the_reference_match_nothing() -> None:
    rng = np.random.default_rng(3)
    one = features(rng, 1)
    reference = features(rng, 2, base=one)
    twins = Features(
        reference.azimuth,
        reference.elevation,
        np.repeat(one.descriptors, 2, axis=0),
        reference.pixels,
        reference.response,
    )
    assert len(match(twins, one, ratio=1.0)) == 0


def test_the_best_taker_keeps_a_reference_feature() -> None:
    rng = np.random.default_rng(4)
    reference = features(rng, 20)
    noise = np.array([0.05, 0.0, 0.03])[:, None] * rng.normal(size=(3, 128))
    query = Features(
        np.zeros(3),
        np.zeros(3),
        (reference.descriptors[7] + noise).astype(np.float32),
        np.zeros((3, 2)),
        np.ones(3),
    )
    i, j, score = match_indices(reference, query)
    assert (i.tolist(), j.tolist()) == ([7], [1])
    assert score[0] < 1e-3


def test_bad_matching() -> None:
    rng = np.random.default_rng(5)
    sift, orb = features(rng, 5), features(rng, 5, binary=True)
    with pytest.raises(ValueError, match="expected one kind, got 128 x float32 and 32 x uint8"):
        match(sift, orb)
    for ratio in (0.0, 1.1, float("nan")):
        with pytest.raises(ValueError, match="ratio: expected"):
            match(sift, sift, ratio=ratio)


@pytest.mark.parametrize(("binary", "threshold"), [(False, 0.65), (True, 0.12)])
def test_distinct_as_naive(binary: bool, threshold: float) -> None:
    rng = np.random.default_rng(6)
    base = features(rng, 30, binary=binary)
    some = features(rng, 40, binary=binary, base=base)
    places = rng.uniform(0.0, 12.0, (40, 2))  # some within 3 pixels
    some = Features(some.azimuth, some.elevation, some.descriptors, places, some.response)
    limit = threshold * 256 if binary else threshold
    expected = naive.distinct(some.descriptors, some.pixels, some.response, limit)
    assert 3 < sum(expected) < 37
    assert distinct(some, threshold).tolist() == expected
    assert distinct(some, 0.0).all()
    assert distinct(some[:0], threshold).size == 0


def test_distinct_over_several_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    some = features(rng, 100, base=features(rng, 60))
    whole = distinct(some, 0.65)
    monkeypatch.setattr("pflut.features.distinct.BLOCK", 7)
    assert np.array_equal(distinct(some, 0.65), whole)
    assert 0 < whole.sum() < 100


def test_seam_keeps_one_of_two_copies() -> None:
    width = 100
    pixels = np.array(
        [
            [50.0, 1.0],  # far from the seam
            [-0.4, 5.0],  # two copies, both between the borders
            [99.5 - 1e-3, 5.1],
            [-0.6, 9.0],  # a copy beyond the left border and its partner inside
            [99.4, 9.0],
            [-0.6, 15.0],  # beyond the border, and nothing like it on the other side
            [99.0, 15.0 + 4.0],
            [-0.7, 22.0],  # two copies, both beyond the borders
            [99.8, 22.0],
            [0.2, 30.0],  # same place, another size: another feature
            [100.2, 30.0],
            [-30.0, 3.0],  # deep in the padding
            [130.0, 3.0],
        ]
    )
    likeness = np.zeros((len(pixels), 2))
    likeness[9, 0] = 1.0
    likeness[1, 1] = 2 * np.pi  # an orientation, not a number
    keep = unique_at_seam(pixels, likeness, width, np.full(len(pixels), 1.5))
    assert keep.tolist() == [1, 0, 1, 0, 1, 0, 1, 0, 1, 1, 0, 0, 0]
