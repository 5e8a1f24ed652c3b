"""Pairs of a dataset's images with matches and true poses."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from pflut.correspondences import Correspondences
from pflut.datasets import Dataset
from pflut.features import FeatureCache, FeatureExtractor
from pflut.geometry import wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.pairs import agreeing, correspondences_and_headings, dataset_pairs, near_pairs
from pflut.relpose.estimate import estimate_relative_pose
from pflut.simulation.correspondences import CorrespondenceSimulator


def test_near_pairs_are_all_and_only_those(room_dataset: Dataset) -> None:
    truth = room_dataset.ground_truth
    assert truth is not None
    expected = [
        [i, j]
        for i in range(len(truth))
        for j in range(i + 1, len(truth))
        if 0.0 < np.hypot(*(truth[i] - truth[j])[:2]) <= 1.4
    ]
    assert near_pairs(room_dataset, 1.4).tolist() == expected


def test_pairs_across_are_of_a_reference_and_a_query(room_dataset: Dataset) -> None:
    references, queries = (
        set(indices.tolist())
        for indices in (room_dataset.reference_indices, room_dataset.query_indices)
    )
    found = near_pairs(room_dataset, 1.4, across=True).tolist()
    every = near_pairs(room_dataset, 1.4).tolist()
    assert 0 < len(found) < len(every)
    assert all(left in references and right in queries for left, right in found)
    mixed = [pair for pair in every if len(references.intersection(pair)) == 1]
    assert sorted(sorted(pair) for pair in found) == mixed
    # where every image is both, each pair once
    assert near_pairs(room_dataset.with_references("all"), 1.4, across=True).tolist() == every
    with pytest.raises(ValueError, match=r"no reference and query with true poses 0 to 1\.4 m"):
        near_pairs(dataclasses.replace(room_dataset, reference_indices=[]), 1.4, across=True)


def test_images_in_one_place_or_without_a_pose_are_no_pair(room_dataset: Dataset) -> None:
    truth = np.full((len(room_dataset), 3), np.nan)
    truth[:3] = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    dataset = dataclasses.replace(room_dataset, ground_truth=truth, reference_indices=[])
    assert near_pairs(dataset, 2.0).tolist() == [[0, 2], [1, 2]]
    with pytest.raises(ValueError, match=r"no two images with true poses 0 to 0\.5 m apart"):
        near_pairs(dataset, 0.5)
    with pytest.raises(ValueError, match="no two images"):
        near_pairs(dataclasses.replace(dataset, ground_truth=None), 2.0)


def test_pairs_of_a_selection(room_dataset: Dataset) -> None:
    truth = room_dataset.ground_truth
    assert truth is not None
    every = near_pairs(room_dataset, 1.4).tolist()
    apart = {
        (i, j): float(np.hypot(*(truth[i] - truth[j])[:2]))
        for i, j in itertools.combinations(range(len(truth)), 2)
    }
    some = np.arange(1, len(truth), 3)
    expected = [pair for pair in every if set(pair) <= set(some.tolist())]
    assert 0 < len(expected) < len(every)
    for images in (slice(1, None, 3), some):
        assert near_pairs(room_dataset, 1.4, images=images).tolist() == expected
    far = near_pairs(room_dataset, 1.4, min_distance=0.8).tolist()
    assert far == [pair for pair in every if apart[tuple(pair)] >= 0.8]
    soon = near_pairs(room_dataset, 1.4, max_gap=2).tolist()
    assert soon == [[i, j] for i, j in every if j - i <= 2]
    assert 0 < len(far) < len(every) and 0 < len(soon) < len(every)
    # pairs across may go back in time
    across = near_pairs(room_dataset, 1.4, across=True)
    gaps = np.abs(across[:, 0] - across[:, 1])
    kept = near_pairs(room_dataset, 1.4, across=True, max_gap=2)
    assert kept.tolist() == across[gaps <= 2].tolist()
    with pytest.raises(ValueError, match=r"no two images with true poses 0\.8 to 0\.7 m apart"):
        near_pairs(room_dataset, 0.7, min_distance=0.8)


def test_selected_pairs_keep_their_numbers_and_headings(
    room_dataset: Dataset, room_cache: FeatureCache
) -> None:
    chosen = {"max_distance": 1.4, "min_distance": 0.3, "images": slice(0, None, 2)}
    pairs = list(dataset_pairs(room_dataset, cache=room_cache, max_gap=6, **chosen))
    expected = near_pairs(room_dataset, 1.4, min_distance=0.3, max_gap=6, images=chosen["images"])
    assert [[pair.index_l, pair.index_r] for pair in pairs] == expected.tolist()
    correspondences, headings = correspondences_and_headings(iter(pairs))
    assert headings.shape == (len(pairs), 2)
    for pair, matches, pose in zip(pairs, correspondences, headings, strict=True):
        assert pair.known == (matches, *pose)
        assert matches is pair.correspondences
    nothing, none = correspondences_and_headings([])
    assert (nothing, none.shape) == ([], (0, 2))


def test_the_default_extractor_looks_where_the_dataset_s_masks_let_it(
    room_dataset: Dataset, room_cache: FeatureCache
) -> None:
    some = {"max_distance": 1.4, "images": slice(0, None, 2), "cache": room_cache}
    band = dataclasses.replace(room_dataset, mask_elevation=(-0.1, 0.3))
    elevation = np.concatenate(
        [pair.correspondences.elevation_l for pair in dataset_pairs(band, **some)]
    )
    assert len(elevation) and elevation.min() >= -0.1 and elevation.max() <= 0.3
    free = np.concatenate(
        [pair.correspondences.elevation_l for pair in dataset_pairs(room_dataset, **some)]
    )
    assert free.min() < -0.1 and free.max() > 0.3


def test_matches_agree_with_the_true_headings(
    room_dataset: Dataset, room_cache: FeatureCache, small_table: LikelihoodTable
) -> None:
    extractor = FeatureExtractor(room_dataset.camera)
    seen: list[tuple[int, int]] = []
    pairs = list(
        dataset_pairs(
            room_dataset,
            extractor,
            max_distance=0.6,
            cache=room_cache,
            progress=lambda done, total: seen.append((done, total)),
        )
    )
    assert seen == [(k + 1, len(pairs)) for k in range(len(pairs))]
    errors = []
    for pair in pairs:
        pose = estimate_relative_pose(pair.correspondences, small_table)
        assert 0.0 < pair.distance <= 0.6
        good = agreeing(pair.correspondences, pose, noise=small_table.noise)
        assert good.sum() == pose.num_inliers
        errors.append([pose.heading_l - pair.heading_l, pose.heading_r - pair.heading_r])
    assert np.median(np.abs(wrap_to_pi(errors))) < np.radians(2.0)


def test_a_table_is_learned_from_pairs(room_dataset: Dataset, room_cache: FeatureCache) -> None:
    pairs = dataset_pairs(room_dataset, max_distance=1.4, cache=room_cache)
    table = LikelihoodTable.from_pairs((pair.known for pair in pairs), bins=16)
    assert table.bins == 16 and table.learned_from["num_samples"] > 1000


def test_agreeing_tells_matches_from_mismatches(small_table: LikelihoodTable) -> None:
    """The simulator puts the mismatches first."""
    simulator = CorrespondenceSimulator(mismatch=0.5, noise=0.002)
    correspondences, heading_l, heading_r = simulator.pair(400, 1)
    pose = estimate_relative_pose(correspondences, small_table)
    assert abs(wrap_to_pi(pose.heading_l - heading_l)) < 0.02
    assert abs(wrap_to_pi(pose.heading_r - heading_r)) < 0.02
    good = agreeing(correspondences, pose)
    assert good[200:].mean() > 0.95 and good[:200].mean() < 0.2
    assert agreeing(Correspondences.empty(), pose).shape == (0,)
