"""Links of images with binary descriptors, from the detector to the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor, match
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs
from pflut.mapping.links import Links
from pflut.mapping.pair_linker import PairLinker
from pflut.mapping.true_links import LinkRule

COUNT = 5


def test_orb_links_a_room(
    room_dataset: Dataset,
    room_cache: FeatureCache,
    small_table: LikelihoodTable,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PairLinker, "warm_up", lambda _: False)  # in this process
    extractor = FeatureExtractor(room_dataset.camera, detector="orb")
    features = [room_cache(extractor, room_dataset.image(k)) for k in range(COUNT)]
    assert all(image.is_binary and len(image) > 50 for image in features)
    links = all_pairs(features, tmp_path, small_table, jobs=1)
    assert len(links) == COUNT * (COUNT - 1) // 2
    for (left, right), number in zip(links.indices, links.num_matches, strict=True):
        assert number == len(match(features[left], features[right], mutual=True))
    # images of one room, next to each other, are linked, and how they stand is known
    poses = room_dataset.ground_truth
    offsets = poses[links.indices[:, 1], :2] - poses[links.indices[:, 0], :2]
    near = np.hypot(*offsets.T) < LinkRule().max_distance
    assert near.any() and (links.probability[near] > 0.5).mean() > 0.5
    again = Links.load(tmp_path / "links.npz")
    np.testing.assert_array_equal(again.probability, links.probability)
