"""Many simulated drives: kept one by one, gone on with, summed up."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pflut._files import write_json
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.replay import ReplayOptions, SeedRun, replay_seed, replay_seeds
from pflut.replay.seeds import summarize_seeds

RUN = SeedRun(0, 0, 20, 3, 0.02, 0.3, 0.1, 2.0, 0.99, 0)
OPTIONS = ReplayOptions(num_particles=1000, bins=32)


@pytest.fixture(autouse=True)
def homes(room_home_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let homes 0 to 2 be the room, in a cache folder of the tests' own."""
    monkeypatch.setenv("PFLUT_CACHE", str(room_home_cache))


def test_a_drive_gives_its_numbers() -> None:
    run = replay_seed(1, OPTIONS, max_images=4)
    assert (run.seed, run.home_seed, run.images) == (1, 1, 4)
    assert run.converged_at is not None and run.position_m is not None
    assert run.position_m < 0.3 and 0.0 < run.odometry_position_m < 0.3


def test_one_home_for_all_varies_filter_and_odometry() -> None:
    runs = [replay_seed(seed, OPTIONS, home_seed=0, max_images=3) for seed in (5, 6)]
    assert [run.home_seed for run in runs] == [0, 0]
    assert runs[0].odometry_position_m != runs[1].odometry_position_m
    assert runs[0].position_m != runs[1].position_m
    assert replay_seed(5, OPTIONS, home_seed=0, max_images=3) == runs[0]


def test_done_drives_are_not_done_again(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    first = list(replay_seeds([0, 1], folder, OPTIONS, max_images=2))
    assert sorted(path.name for path in folder.glob("seed_*")) == ["seed_0.json", "seed_1.json"]
    other = dataclasses.replace(first[0], images=99)
    write_json(folder / "seed_0.json", dataclasses.asdict(other))
    again = list(replay_seeds([0, 1, 2], folder, OPTIONS, max_images=2))
    assert again[:2] == [other, first[1]] and again[2].seed == 2


def test_processes_give_the_same_drives(tmp_path: Path) -> None:
    alone = list(replay_seeds([0, 1], tmp_path / "a", OPTIONS, max_images=2))
    together = list(replay_seeds([0, 1], tmp_path / "b", OPTIONS, max_images=2, jobs=2))
    assert sorted(together, key=lambda run: run.seed) == alone


def test_drives_of_other_options_are_not_mixed(tmp_path: Path) -> None:
    list(replay_seeds([0], tmp_path / "runs", OPTIONS, max_images=2))
    other = dataclasses.replace(OPTIONS, temperature=0.5)
    with pytest.raises(ValueError, match="drives with another temperature, expected a new folder"):
        list(replay_seeds([0], tmp_path / "runs", other, max_images=2))
    with pytest.raises(ValueError, match="another max_images"):
        list(replay_seeds([0], tmp_path / "runs", OPTIONS, max_images=3))


def test_drives_of_other_tables_are_not_mixed(
    tmp_path: Path, small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    name = tmp_path / "table.npz"
    small_table.save(name)
    options = dataclasses.replace(OPTIONS, table=str(name), bins=None)
    (run,) = replay_seeds([0], tmp_path / "runs", options, max_images=2)
    assert run == replay_seed(0, OPTIONS, max_images=2)  # the default table of 32 bins by a file
    assert list(replay_seeds([0], tmp_path / "runs", options, max_images=2)) == [run]
    default = dataclasses.replace(OPTIONS, bins=None)
    with pytest.raises(ValueError, match="drives with another table, expected a new folder"):
        list(replay_seeds([0], tmp_path / "runs", default, max_images=2))
    small_dense_table.save(name)
    with pytest.raises(ValueError, match="drives with another table, expected a new folder"):
        list(replay_seeds([0], tmp_path / "runs", options, max_images=2))


def test_processes_have_the_same_table(tmp_path: Path, small_dense_table: DenseTable) -> None:
    small_dense_table.save(tmp_path / "table.npz")
    options = dataclasses.replace(OPTIONS, table=str(tmp_path / "table.npz"))
    together = list(replay_seeds([0, 1], tmp_path / "runs", options, max_images=2, jobs=2))
    for run in together:
        assert run == replay_seed(run.seed, options, max_images=2)
        assert run != replay_seed(run.seed, OPTIONS, max_images=2)


def test_a_damaged_result_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "seed_0.json").write_text('{"seed": 0}')
    with pytest.raises(ValueError, match=r"seed_0\.json: expected a drive's result"):
        list(replay_seeds([0], tmp_path, OPTIONS))


def test_summary_counts_and_bounds() -> None:
    at = [0, 3, 9, 10, None]
    runs = [
        dataclasses.replace(
            RUN,
            seed=seed,
            converged_at=step,
            position_m=None if step is None else 0.01 * (seed + 1),
        )
        for seed, step in enumerate(at)
    ]
    summary = summarize_seeds(runs, within=10)
    assert summary["success"]["successes"] == 3 and summary["success"]["count"] == 5
    assert summary["failed_seeds"] == [3, 4] and summary["converged_ever"] == 4
    assert summary["images_to_convergence"]["median"] == np.median([1, 4, 10, 11])
    position = summary["position_m"]
    assert position["median"] == pytest.approx(0.025) and position["maximum"] == 0.04
    assert position["median_low"] <= position["median"] <= position["median_high"]


def test_summary_of_failures_alone_holds_no_numbers() -> None:
    lost = dataclasses.replace(RUN, converged_at=None, position_m=None, heading_deg=None)
    summary = summarize_seeds([lost])
    assert summary["success"]["rate"] == 0.0 and summary["position_m"]["median"] is None
    assert summary["position_m"]["median_low"] is None
