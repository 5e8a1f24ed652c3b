"""The results folder: files that others read, written as the replay goes."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from pflut import __version__
from pflut._files import read_json, write_csv, write_json
from pflut.datasets import Dataset
from pflut.features import FeatureCache
from pflut.likelihood.table import LikelihoodTable
from pflut.replay import ReplayOptions, ReplayResult, replay_dataset
from pflut.results import (
    StepsWriter,
    create_results_folder,
    remove_results,
    run_record,
    step_row,
    write_results,
)
from pflut.trajectory import read_tum


@pytest.fixture(scope="module")
def result(
    room_dataset: Dataset, small_table: LikelihoodTable, room_cache: FeatureCache
) -> ReplayResult:
    options = ReplayOptions(num_particles=500, start="truth")
    return replay_dataset(room_dataset, options, table=small_table, cache=room_cache, max_images=4)


def test_trajectories_come_back_as_they_were(result: ReplayResult, tmp_path: Path) -> None:
    write_results(tmp_path, result)
    poses = read_tum(tmp_path / "poses.tum")
    np.testing.assert_array_equal(poses.stamps, result.stamps)
    np.testing.assert_allclose(poses.poses, result.estimates, atol=1e-12)
    truth = read_tum(tmp_path / "groundtruth.tum")
    np.testing.assert_allclose(truth.poses, result.ground_truth, atol=1e-12)
    np.testing.assert_allclose(
        read_tum(tmp_path / "odometry.tum").poses, result.odometry_alone, atol=1e-12
    )


def test_the_same_result_gives_the_same_bytes_and_no_timings_among_metrics(
    result: ReplayResult, tmp_path: Path
) -> None:
    slower = dataclasses.replace(
        result,
        steps=tuple(
            dataclasses.replace(step, timings={k: 2 * v for k, v in step.timings.items()})
            for step in result.steps
        ),
    )
    for name, each in (("a", result), ("b", slower)):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, each)
    for name in ("poses.tum", "metrics.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a/timings.json").read_bytes() != (tmp_path / "b/timings.json").read_bytes()


def test_metrics_are_those_of_the_errors(result: ReplayResult, tmp_path: Path) -> None:
    write_results(tmp_path, result)
    metrics = read_json(tmp_path / "metrics.json")
    assert result.errors is not None
    assert metrics["images"] == 4 and metrics["references"] == 12
    position = metrics["errors"]["all"]["position_m"]
    assert position["median"] == np.median(result.errors.position)
    assert position["rmse"] == pytest.approx(np.sqrt(np.mean(result.errors.position**2)))
    heading = metrics["errors"]["all"]["heading_deg"]["median"]
    assert heading == pytest.approx(np.degrees(np.median(np.abs(result.errors.heading))))


def test_steps_are_on_disk_before_the_next_image(result: ReplayResult, tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    with StepsWriter(path) as writer:
        for number, step in enumerate(result.steps):
            writer.add(step_row(number, step))
            rows = list(csv.DictReader(path.read_text().splitlines()))
            assert len(rows) == number + 1
            row = {name: float(value) for name, value in rows[-1].items()}
            assert row["image"] == step.index and row["stamp"] == step.stamp
            pose = [row["x_m"], row["y_m"], np.radians(row["heading_deg"])]
            np.testing.assert_allclose(pose, step.estimate.pose, rtol=1e-8)
            assert result.errors is not None
            assert row["error_m"] == pytest.approx(result.errors.position[number])
            assert row["error_deg"] == pytest.approx(np.degrees(result.errors.heading[number]))
            assert row["match_ms"] == pytest.approx(1e3 * step.timings["match"])


def test_stamps_that_count_from_1970_come_back(tmp_path: Path) -> None:
    stamps = [1700000000.123456, 1700000000.173456, 0.1 + 0.2]
    with StepsWriter(tmp_path / "steps.csv") as writer:
        for stamp in stamps:
            writer.add({"stamp": np.float64(stamp)})
    rows = csv.DictReader((tmp_path / "steps.csv").read_text().splitlines())
    np.testing.assert_allclose([float(row["stamp"]) for row in rows], stamps, rtol=0.0, atol=1e-9)


def test_steps_without_truth_leave_their_errors_empty(result: ReplayResult, tmp_path: Path) -> None:
    unknown = dataclasses.replace(result.steps[0], ground_truth=None)
    with StepsWriter(tmp_path / "steps.csv") as writer:
        writer.add(step_row(0, unknown))
        writer.add(step_row(1, result.steps[1]))
    first, second = csv.DictReader((tmp_path / "steps.csv").read_text().splitlines())
    assert first["error_m"] == first["along_track_m"] == "" and float(second["error_m"]) >= 0.0


def test_run_record_says_how_it_was_made() -> None:
    record = run_record(["pflut", "replay"], seed=7)
    assert record["command"] == ["pflut", "replay"] and record["seed"] == 7
    assert record["versions"]["pflut"] == __version__
    assert record["versions"]["numpy"] == np.__version__
    assert set(record["versions"]) >= {"python", "numba", "opencv"}
    assert "unknown" not in record["versions"].values()
    json.dumps(record, allow_nan=False)


def test_default_folders_have_date_and_name_and_are_never_shared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [create_results_folder(None, "A home/floor: 1") for _ in range(3)]
    assert len(set(folders)) == 3 and all(folder.is_dir() for folder in folders)
    assert folders[0].parent == Path("results") and "a-home-floor-1" in folders[0].name


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    assert create_results_folder(tmp_path / "new", "x").is_dir()
    assert create_results_folder(tmp_path / "new", "x").is_dir()  # empty
    (tmp_path / "new" / "poses.tum").write_text("precious")
    with pytest.raises(FileExistsError, match="holds something already"):
        create_results_folder(tmp_path / "new", "x")
    assert create_results_folder(tmp_path / "new", "x", overwrite=True).is_dir()
    assert (tmp_path / "new" / "poses.tum").read_text() == "precious"


def test_only_a_replays_own_files_are_removed(result: ReplayResult, tmp_path: Path) -> None:
    write_results(tmp_path, result)
    (tmp_path / "figures").mkdir()
    remove_results(tmp_path)  # no run.json: it is not known whose files these are
    assert (tmp_path / "poses.tum").is_file()
    for name in ("run.json", "figures/errors.png", "notes.txt", "settings.json"):
        (tmp_path / name).touch()
    remove_results(tmp_path)
    assert {path.name for path in tmp_path.rglob("*")} == {"notes.txt", "settings.json"}


def test_json_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": ')
    with pytest.raises(ValueError, match=r"a\.json: not a JSON file"):
        read_json(path)
    path.write_text("[1]")
    with pytest.raises(ValueError, match=r"a\.json: expected a JSON object, got list"):
        read_json(path)
    write_json(path, {"b": 1.5})
    assert read_json(path) == {"b": 1.5}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, {"b": np.nan})
    assert read_json(path) == {"b": 1.5}


def test_a_table_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_csv(path, ("name", "x"), [("a, b", 0.1 + 0.2), ("c", 2)])
    assert path.read_text() == 'name,x\n"a, b",0.30000000000000004\nc,2\n'

    def rows():
        yield ("d", 3)
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError):
        write_csv(path, ("name", "x"), rows())
    assert path.read_text().endswith("c,2\n")
    assert list(tmp_path.iterdir()) == [path]
