"""Correspondences: what they take, select and exchange."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.correspondences import Correspondences

FIELDS = ("azimuth_l", "elevation_l", "azimuth_r", "elevation_r", "quality")


def some(n: int = 5) -> Correspondences:
    rng = np.random.default_rng(0)
    angles = [rng.uniform(-7, 7, n), rng.uniform(-1.5, 1.5, n)] * 2
    return Correspondences(*angles, quality=rng.uniform(0, 1, n))


def test_azimuths_are_wrapped_and_lists_taken() -> None:
    c = Correspondences([-0.5, 7.0], [0, 1], [2 * np.pi, -1e-17], [-np.pi / 2, np.pi / 2])
    assert c.azimuth_l == pytest.approx([2 * np.pi - 0.5, 7.0 - 2 * np.pi])
    assert (c.azimuth_r == 0.0).all()
    assert c.elevation_l.dtype == np.float64
    assert c.quality is None
    assert len(c) == 2


@pytest.mark.parametrize("index", [slice(1, 4), np.array([4, 0]), np.arange(5) % 2 == 0])
def test_selection(index) -> None:
    c = some()
    for name in FIELDS:
        assert (getattr(c[index], name) == getattr(c, name)[index]).all()


def test_exchange_is_its_own_inverse() -> None:
    c = some()
    once, twice = c.exchanged(), c.exchanged().exchanged()
    assert (once.azimuth_l == c.azimuth_r).all()
    assert (once.elevation_r == c.elevation_l).all()
    for name in FIELDS:
        assert (getattr(twice, name) == getattr(c, name)).all()


def test_none() -> None:
    assert len(Correspondences.empty()) == 0
    assert len(some()[np.zeros(5, bool)]) == 0
    assert len(Correspondences([], [], [], [])) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"elevation_l": [0.0]}, r"elevation_l: expected shape \(2,\), got \(1,\)"),
        ({"azimuth_l": [[0.0, 1.0]]}, "azimuth_l: expected shape"),
        ({"azimuth_r": [0.0, np.nan]}, "azimuth_r: value 1 is not finite"),
        ({"elevation_r": [np.inf, 0.0]}, "elevation_r: value 0 is not finite"),
        ({"elevation_r": [0.0, 1.58]}, r"elevation_r: value 1 is 1.58, expected radians"),
        ({"quality": [0.0]}, "quality: expected shape"),
        ({"quality": [0.0, np.nan]}, "quality: value 1 is not finite"),
    ],
)
def test_misuse_names_the_field(change: dict, message: str) -> None:
    fields = {name: [0.0, 0.0] for name in FIELDS[:4]}
    with pytest.raises(ValueError, match=message):
        Correspondences(**(fields | change))


@pytest.mark.parametrize("quality", [-0.5, 1.5])
def test_quality_beyond_its_range_is_named(quality: float) -> None:
    with pytest.raises(ValueError, match="quality: value 1 is"):
        Correspondences([1.0, 2.0], [0.1, 0.1], [1.0, 2.0], [0.1, 0.1], [0.5, quality])
