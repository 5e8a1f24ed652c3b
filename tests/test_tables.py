"""The likelihood table of a replay: found by its name, with grids that suit the camera."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pflut.camera import (
    Camera,
    EquirectangularPanorama,
    Fisheye,
    HyperbolicMirror,
    Mount,
    Perspective,
)
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.replay.tables import (
    COMMON_BINS,
    DENSE_BINS,
    SHARP_BINS,
    camera_bins,
    choose_table,
    table_record,
)

SHARP = Perspective(1226, 370, 707, 707, 602, 183)
MIRROR = HyperbolicMirror(1024, 768, 0.97, 350, 350, 511, 383, elevation_min=-0.8)


@pytest.mark.parametrize(
    ("camera", "bins"),
    [
        (EquirectangularPanorama(1024, 512), COMMON_BINS),
        (EquirectangularPanorama(4096, 2048), SHARP_BINS),
        (MIRROR, COMMON_BINS),
        (Fisheye(1000, 1000, 300, 300, 500, 500, looks="up"), COMMON_BINS),
        (SHARP, SHARP_BINS),
        (Perspective(320, 240, 180, 180, 160, 120), COMMON_BINS),
        (Perspective(1226, 370, 707, 707, 602, 183, mount=Mount(pitch=0.3)), SHARP_BINS),
    ],
    ids=lambda value: getattr(value, "width", value),
)
def test_sharp_cameras_have_more_bins(camera: Camera, bins: int) -> None:
    assert camera_bins(camera) == bins


def test_the_default_table_suits_the_camera_unless_told_otherwise() -> None:
    assert choose_table().bins == COMMON_BINS
    assert choose_table(camera=SHARP).bins == SHARP_BINS
    table = choose_table(camera=SHARP, bins=50)
    assert isinstance(table, LikelihoodTable) and table.bins == 50
    np.testing.assert_array_equal(table.density, LikelihoodTable.default().density)


def test_a_table_for_sharp_perspective_cameras_is_there_by_its_name() -> None:
    table, other = choose_table("perspective", camera=SHARP), choose_table(camera=SHARP)
    assert isinstance(table, LikelihoodTable) and isinstance(other, LikelihoodTable)
    assert table.bins == SHARP_BINS and table.noise < 0.5 * other.noise


def test_a_table_for_homes_is_there_by_its_name() -> None:
    table, other = choose_table("home"), choose_table()
    assert isinstance(table, LikelihoodTable) and isinstance(other, LikelihoodTable)
    assert table.bins == other.bins and table.noise < 0.6 * other.noise
    learned_from = table.learned_from["simulator"]
    assert (learned_from["scene"], learned_from["noise"]) == ("box", 0.005)
    assert table.learned_from["learning_version"] == other.learned_from["learning_version"]


def test_the_papers_table_is_learned_once(
    small_dense_table: DenseTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, object]] = []

    def learned(*, bins: int, progress: object) -> DenseTable:
        asked.append((bins, progress))
        return small_dense_table

    monkeypatch.setattr(DenseTable, "default", learned)
    assert choose_table("dense", progress=print) is small_dense_table
    choose_table("dense", camera=SHARP)
    choose_table("dense", camera=SHARP, bins=32)
    assert asked == [(DENSE_BINS, print), (SHARP_BINS, None), (32, None)]


def test_a_residual_tables_file_has_bins_of_its_own_unless_told_otherwise(
    tmp_path: Path, small_table: LikelihoodTable
) -> None:
    name = str(tmp_path / "table.npz")
    small_table.save(name)
    assert choose_table(name, camera=SHARP).bins == 32
    assert choose_table(name, camera=SHARP, bins=64).bins == 64


def test_a_dense_tables_file_has_bins_of_its_own(
    tmp_path: Path, small_dense_table: DenseTable
) -> None:
    name = str(tmp_path / "table.npz")
    small_dense_table.save(name)
    for bins in (None, 32):
        table = choose_table(name, camera=SHARP, bins=bins)
        assert isinstance(table, DenseTable) and table.bins == 32
    with pytest.raises(
        ValueError, match=r"table\.npz: a dense table of 32 bins, it cannot have 64"
    ):
        choose_table(name, bins=64)


def test_records_tell_tables_of_one_name_apart(
    tmp_path: Path, small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    name = str(tmp_path / "table.npz")
    records = []
    for table in (small_table, small_table.with_bins(33), small_dense_table):
        table.save(name)
        record = table_record(name, choose_table(name))
        assert record["file"] == name and json.loads(json.dumps(record)) == record
        records.append(record)
    assert records[0] != records[1] != records[2] != records[0]
    shutil.copy(name, tmp_path / "copy.npz")
    assert table_record(name, choose_table(str(tmp_path / "copy.npz"))) == records[2]
