"""Features in blocks: whole numbers whose products are exact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pflut.features import Features
from pflut.features.matching import similarity_scores
from pflut.mapping.feature_blocks import BLOCK, MAX_LENGTH, SCALE, FeatureBlock, in_blocks


def test_products_of_whole_numbers_are_exact() -> None:
    """The longest that there may be, so that a sum in another order is the same."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(300, 128))
    rows *= (MAX_LENGTH - 1e-4) / np.linalg.norm(rows, axis=1, keepdims=True)
    rows[1] = rows[0]
    none = np.zeros(300)
    block = FeatureBlock.of(
        [Features(none, none, rows.astype(np.float32), np.zeros((300, 2)), none)]
    )
    whole = block.descriptors.astype(np.int64)
    assert block.descriptors.dtype == np.int16
    assert np.abs(whole / SCALE - rows).max() <= 0.5 / SCALE + 1e-6
    exact = whole @ whole.T
    assert 2**23 < exact.max() < 2**24
    image = block.image(0)
    assert np.array_equal(similarity_scores(image, image), exact)
    assert np.array_equal(image.squared_norms, np.diag(exact))


def test_blocks_hold_the_images(features: list[Features], tmp_path: Path) -> None:
    many = [*features, *features, features[0][:0], *features]
    blocks = list(in_blocks(iter(many)))
    assert [len(block) for block in blocks] == [BLOCK, len(many) - BLOCK]
    blocks[1].save(tmp_path / "block.npz")
    read = FeatureBlock.load(tmp_path / "block.npz")
    assert read.digest == blocks[1].digest != blocks[0].digest
    for number, one in enumerate(many):
        block, place = divmod(number, BLOCK)
        image = (blocks[0], read)[block].image(place)
        assert np.array_equal(image.azimuth, one.azimuth)
        assert np.array_equal(image.elevation, one.elevation)
        difference = image.descriptors / np.float32(SCALE) - one.descriptors
        assert np.abs(difference).max(initial=0.0) < 0.51 / SCALE
    np.savez(tmp_path / "none.npz", offsets=np.zeros(1))
    with pytest.raises(ValueError, match=r"none\.npz: not a block of features"):
        FeatureBlock.load(tmp_path / "none.npz")


def test_bits_stay_bits() -> None:
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 256, (9, 32), dtype=np.uint8)
    none = np.zeros(9)
    image = FeatureBlock.of([Features(none, none, bits, np.zeros((9, 2)), none)]).image(0)
    assert image.is_binary and np.array_equal(image.descriptors, bits)


def test_descriptors_that_are_no_unit_vectors(features: list[Features]) -> None:
    longer = replace(features[0], descriptors=512 * features[0].descriptors)
    with pytest.raises(ValueError, match=r"descriptors: expected unit vectors, got .* length 512"):
        FeatureBlock.of([features[1], longer])
    shorter = replace(features[0], descriptors=features[0].descriptors[:, :16])
    with pytest.raises(ValueError, match="features: expected one kind of descriptor, got"):
        FeatureBlock.of([features[1], shorter])
