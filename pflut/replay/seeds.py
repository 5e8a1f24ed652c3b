"""Replays of many simulated drives, a seed each: how often, how fast and how well."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pflut._files import read_json, write_json
from pflut.evaluation import bootstrap_median, success_rate, summarize
from pflut.replay.options import ReplayOptions

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class SeedRun:
    """The outcome of one simulated drive.

    Parameters
    ----------
    seed, home_seed : int
        Of the filter, and of the home, its drives and its odometry.
    images : int
        Of the test drive.
    converged_at : int or None
        The step, from 0, from which on the estimates stay within 0.5 m and 10 degrees.
    position_m, heading_deg : float or None
        Median errors from there on.
    odometry_position_m, odometry_heading_deg : float
        Median errors of the odometry alone, from the true start.
    confidence : float
        Median.
    degenerate : int
        Images that were ignored.
    """

    seed: int
    home_seed: int
    images: int
    converged_at: int | None
    position_m: float | None
    heading_deg: float | None
    odometry_position_m: float
    odometry_heading_deg: float
    confidence: float
    degenerate: int

    @classmethod
    def from_json(cls, path: Path) -> SeedRun:
        """Read a run's file.

        Raises
        ------
        ValueError
            Naming the file, if it is none.
        """
        content = read_json(path)
        names = {item.name for item in fields(cls)}
        if set(content) != names:
            raise ValueError(f"{path}: expected a drive's result with {', '.join(sorted(names))}")
        return cls(**content)


def replay_seed(
    seed: int,
    options: ReplayOptions | None = None,
    *,
    home_seed: int | None = None,
    people: int = 0,
    motion_blur: float = 0.0,
    max_images: int | None = None,
    cached: bool = True,
) -> SeedRun:
    """Replay a simulated drive; the home is rendered if it was not before.

    Parameters
    ----------
    seed : int
        Of the filter; of the home too, without ``home_seed``.
    options : ReplayOptions, optional
        The seed in it does not count.
    home_seed : int, optional
        Fixes the home and its drives: then only the filter and the odometry depend on ``seed``.
    people, motion_blur
        See `pflut.datasets.load_simulated_home`.
    max_images : int, optional
        Stop after so many query images.
    cached : bool
        Whether features are looked up in, and added to, the user's cache.

    Returns
    -------
    SeedRun
    """
    from pflut.datasets.simulated_home import load_simulated_home
    from pflut.features import FeatureCache
    from pflut.replay.pipeline import replay_dataset
    from pflut.simulation.odometry import simulate_odometry

    chosen = replace(ReplayOptions() if options is None else options, seed=seed)
    dataset = load_simulated_home(
        seed if home_seed is None else home_seed, people=people, motion_blur=motion_blur
    )
    if home_seed is not None and dataset.ground_truth is not None:
        odometry = np.full((len(dataset), 3), np.nan)
        odometry[dataset.query_indices] = simulate_odometry(
            dataset.ground_truth[dataset.query_indices], rng=np.random.default_rng([seed, 2])
        )
        dataset = dataset.with_odometry(odometry)
    result = replay_dataset(
        dataset, chosen, max_images=max_images, cache=FeatureCache() if cached else None
    )
    assert result.errors is not None and result.odometry_errors is not None  # simulated
    start = result.errors.converged_at
    after = None if start is None else result.errors[start:]
    alone = result.odometry_errors
    return SeedRun(
        seed=seed,
        home_seed=seed if home_seed is None else home_seed,
        images=len(result),
        converged_at=start,
        position_m=None if after is None else summarize(after.position).median,
        heading_deg=None if after is None else summarize(np.degrees(after.heading)).median,
        odometry_position_m=summarize(alone.position).median,
        odometry_heading_deg=summarize(np.degrees(alone.heading)).median,
        confidence=summarize(result.confidence).median,
        degenerate=sum(step.estimate.degenerate for step in result.steps),
    )


def drive_file(folder: Path, seed: int) -> Path:
    """Name the file that keeps a drive's result."""
    return folder / f"seed_{seed}.json"


def replay_seeds(
    seeds: Iterable[int],
    folder: str | os.PathLike[str],
    options: ReplayOptions | None = None,
    *,
    jobs: int = 1,
    **settings: Any,
) -> Generator[SeedRun, None, None]:
    """Replay simulated drives in processes; what a folder holds already is not done again.

    Parameters
    ----------
    seeds : iterable of int
    folder : path
        Gets ``seed_<n>.json`` for each drive as soon as it is done, and ``settings.json``: the
        options, the settings and how the likelihood table was learned.
    options : ReplayOptions, optional
    jobs : int
        Processes; 1 works in this one. With more, a script that calls this needs the usual
        ``if __name__ == "__main__":``.
    **settings
        ``home_seed``, ``people``, ``motion_blur``, ``max_images`` and ``cached`` of `replay_seed`.

    Yields
    ------
    SeedRun
        Those of the folder first, the others as they are done.

    Raises
    ------
    ValueError
        If the folder holds drives with other options or another likelihood table.
    """
    from pflut.replay.tables import choose_table, table_record

    chosen = ReplayOptions() if options is None else options
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    # loaded here once: the paper's table is then in the cache before processes ask for it
    table = table_record(chosen.table, choose_table(chosen.table, bins=chosen.bins))
    about = {"options": chosen.as_dict(), "table": table}
    _same_settings(target / "settings.json", about | settings)
    wanted = list(dict.fromkeys(seeds))
    missing = []
    for seed in wanted:
        path = drive_file(target, seed)
        if path.is_file():
            yield SeedRun.from_json(path)
        else:
            missing.append(seed)
    work = partial(_run_and_keep, folder=target, options=chosen, settings=settings)
    if jobs == 1 or len(missing) <= 1:
        yield from map(work, missing)
        return
    with _single_threaded():
        # spawned, not forked: threads of BLAS and OpenCV do not survive a fork
        pool = multiprocessing.get_context("spawn").Pool(min(jobs, len(missing)), _start_worker)
    with pool:
        yield from pool.imap_unordered(work, missing)


def summarize_seeds(runs: Iterable[SeedRun], *, within: int = 10) -> dict[str, Any]:
    """Sum up many drives.

    Parameters
    ----------
    runs : iterable of SeedRun
    within : int
        A drive is a success if it converges within so many images.

    Returns
    -------
    dict
        The success rate with its Wilson interval; the images until convergence; the medians of
        the drives' median errors after it, with bootstrap intervals and the worst drive.
    """
    ordered = sorted(runs, key=lambda run: (run.seed, run.home_seed))
    converged = [run for run in ordered if run.converged_at is not None]
    good = [run.converged_at is not None and run.converged_at < within for run in ordered]
    images = [run.converged_at + 1 for run in converged if run.converged_at is not None]
    summary: dict[str, Any] = {
        "drives": len(ordered),
        "within_images": within,
        "success": success_rate(good).as_dict(),
        "failed_seeds": [run.seed for run, ok in zip(ordered, good, strict=True) if not ok],
        "converged_ever": len(converged),
        "images_to_convergence": summarize(images).as_dict(),
    }
    for name in ("position_m", "heading_deg"):
        medians = [getattr(run, name) for run in converged]
        low, high = bootstrap_median(medians, rng=0)
        summary[name] = {
            **summarize(medians).as_dict(),
            "median_low": low if medians else None,
            "median_high": high if medians else None,
            "odometry_alone": summarize(
                [getattr(run, f"odometry_{name}") for run in ordered]
            ).as_dict()["median"],
        }
    return summary


def _run_and_keep(
    seed: int, *, folder: Path, options: ReplayOptions, settings: Mapping[str, Any]
) -> SeedRun:
    """Replay one drive and write its file."""
    run = replay_seed(seed, options, **settings)
    write_json(drive_file(folder, seed), asdict(run))
    return run


def _same_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Refuse to mix drives of different options in one folder."""
    wanted = json.loads(json.dumps(settings))
    # the drives' own seeds count, and whether features were cached changes no number
    wanted["options"].pop("seed")
    wanted.pop("cached", None)
    if not path.is_file():
        write_json(path, wanted)
        return
    found = read_json(path)
    if found != wanted:
        here, there = ({**s.get("options", {}), **s} for s in (wanted, found))
        names = sorted(set(here) | set(there) - {"options"})
        other = [n for n in names if n != "options" and here.get(n) != there.get(n)]
        raise ValueError(
            f"{path.parent}: holds drives with another {', '.join(other) or 'setting'}, expected "
            "a new folder"
        )


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Let processes that are started here use one thread each: they fill the cores themselves."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, and the other cores to the other processes."""
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
