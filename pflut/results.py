"""The folder of a replay's results.

``poses.tum``, ``groundtruth.tum`` and ``odometry.tum`` (trajectories, for ``evo_ape tum`` and the
like), ``steps.csv`` (a row an image), ``metrics.json`` (the same seed gives the same bytes),
``timings.json``, ``run.json`` (how it was made) and ``figures/``.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pflut._files import write_json
from pflut.environment import machine, versions
from pflut.evaluation import trajectory_errors
from pflut.geometry import FloatArray
from pflut.replay.result import ReplayResult, ReplayStep
from pflut.trajectory import Trajectory, write_tum

REPLAY_FILES = (
    "poses.tum",
    "groundtruth.tum",
    "odometry.tum",
    "steps.csv",
    "metrics.json",
    "timings.json",
    "figures/trajectory.png",
    "figures/errors.png",
    "figures/confidence.png",
    "figures/posterior.png",
    "figures/particles.gif",
    "run.json",
)


def create_results_folder(
    path: str | os.PathLike[str] | None,
    name: str,
    *,
    overwrite: bool = False,
    expected: str = "a new folder",
) -> Path:
    """Create the folder of a run.

    Parameters
    ----------
    path : path, optional
        By default ``results/<date>_<time>_<name>`` in the working directory.
    name : str
        Of the dataset; what no file name should hold becomes ``-``.
    overwrite : bool
        Whether ``path`` may hold something already; files of the same names are replaced.
    expected : str
        What the error message says that is expected instead of a folder that holds something.

    Returns
    -------
    Path
        An existing folder.

    Raises
    ------
    FileExistsError
        If it holds something.
    """
    if path is None:
        slug = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.").lower() or "run"
        stem = f"{datetime.now():%Y-%m-%d_%H%M%S}_{slug}"
        folder = Path("results") / stem
        count = 2
        while folder.exists():
            folder = folder.with_name(f"{stem}_{count}")
            count += 1
    else:
        folder = Path(path)
        if not overwrite and folder.is_dir() and any(folder.iterdir()):
            raise FileExistsError(f"{folder}: holds something already, expected {expected}")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def remove_results(folder: Path, files: Iterable[str] = REPLAY_FILES) -> None:
    """Delete the files of a former run from its folder, and nothing else.

    A new run that is interrupted would otherwise leave its poses beside the figures of another.
    A folder without ``run.json`` is no former run's: nothing is deleted.

    Parameters
    ----------
    folder : Path
        Need not hold any.
    files : iterable of str
        Their names, ``run.json`` last: what removes them all knows a run's folder by it. Folders
        below that they leave empty are deleted, too.
    """
    if not (folder / "run.json").is_file():
        return
    paths = [folder / name for name in files]
    for path in paths:
        path.unlink(missing_ok=True)
    for below in {path.parent for path in paths} - {folder}:
        if below.is_dir() and not any(below.iterdir()):
            below.rmdir()


class StepsWriter:
    """Writes ``steps.csv`` while a run goes on: each row is on disk before the next image.

    Parameters
    ----------
    path : path
        Replaced if it exists.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = Path(path).open("w", encoding="utf-8", newline="")  # noqa: SIM115
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._columns: list[str] = []

    def __enter__(self) -> StepsWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(self, row: Mapping[str, float | int | str | None]) -> None:
        """Write a step.

        Parameters
        ----------
        row : mapping
            By column, in the order of the first row; None leaves a cell empty.
        """
        if not self._columns:
            self._columns = list(row)
            self._rows.writerow(self._columns)
        self._rows.writerow([_cell(row[column]) for column in self._columns])
        self._file.flush()


def step_row(number: int, step: ReplayStep) -> dict[str, float | int | None]:
    """Give a step's row of ``steps.csv``: None where it has no ground truth."""
    estimate = step.estimate
    row: dict[str, float | int | None] = {
        "step": number,
        "image": step.index,
        "stamp": step.stamp,
        "x_m": float(estimate.pose[0]),
        "y_m": float(estimate.pose[1]),
        "heading_deg": float(np.degrees(estimate.pose[2])),
    }
    names = ("error_m", "error_deg", "along_track_m", "cross_track_m")
    row |= dict.fromkeys(names)
    if step.ground_truth is not None:
        errors = trajectory_errors(estimate.pose[None], step.ground_truth[None])
        values = (errors.position, np.degrees(errors.heading), errors.along_track)
        row |= dict(zip(names, (float(v[0]) for v in (*values, errors.cross_track)), strict=True))
    row |= {
        "confidence": estimate.confidence,
        "position_std_m": estimate.position_std,
        "heading_std_deg": float(np.degrees(estimate.heading_std)),
        "ess": estimate.effective_sample_size,
        "likelihood_exponent": estimate.likelihood_exponent,
        "resampled": int(estimate.resampled),
        "degenerate": int(estimate.degenerate),
        "references": step.num_references,
        "matches": step.num_matches,
    }
    return row | {f"{stage}_ms": 1e3 * seconds for stage, seconds in step.timings.items()}


def write_trajectories(folder: Path, result: ReplayResult) -> None:
    """Write ``poses.tum``, and where they are known ``groundtruth.tum`` and ``odometry.tum``."""
    _write_known(folder / "poses.tum", result.stamps, result.estimates)
    if result.ground_truth is not None:
        _write_known(folder / "groundtruth.tum", result.stamps, result.ground_truth)
    if result.odometry_alone is not None:
        _write_known(folder / "odometry.tum", result.stamps, result.odometry_alone)


def write_results(folder: Path, result: ReplayResult) -> None:
    """Write the trajectories, ``metrics.json`` and ``timings.json``."""
    write_trajectories(folder, result)
    write_json(folder / "metrics.json", result.metrics())
    write_json(folder / "timings.json", {"seconds_per_image": result.timings()})


def run_record(command: list[str], **about: Any) -> dict[str, Any]:
    """Say how a result was made, for ``run.json``.

    Parameters
    ----------
    command : list of str
        As it was typed.
    **about
        Dataset, options and what else there is.

    Returns
    -------
    dict
        With the time, the versions and the machine.
    """
    return {
        "command": command,
        "started": datetime.now().astimezone().isoformat(timespec="seconds"),
        **about,
        "versions": versions(),
        "machine": machine(),
    }


def _write_known(path: Path, stamps: FloatArray, poses: FloatArray) -> None:
    known = np.isfinite(poses).all(axis=1)
    write_tum(path, Trajectory(stamps[known], poses[known]))


def _cell(value: float | int | str | None) -> str:
    """Write a number so that it comes back to a tenth of a micrometre and a nanosecond."""
    if value is None:
        return ""
    if isinstance(value, int | str):
        return str(value)
    # stamps that count from 1970 have so many digits before the point
    return f"{value:.10g}" if abs(value) < 1e4 else repr(float(value))
