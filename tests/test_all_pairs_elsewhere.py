"""All pairs in processes and on a cluster: the same bytes, whatever ends half-way."""

from __future__ import annotations

import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from along_a_line import (
    BATCHES,
    COUNT,
    PAIRS,
    UNGUARDED,
    StopError,
    start_alone,
    stop_after,
)

from pflut.features import Features
from pflut.mapping.feature_blocks import BLOCK
from pflut.mapping.links import Links


def test_processes_give_the_same_bytes(
    link: Callable[..., Links], anywhere: bytes, tmp_path: Path
) -> None:
    link(tmp_path / "run", jobs=2)
    assert (tmp_path / "run" / "links.npz").read_bytes() == anywhere


def test_a_plain_script_after_an_installation(tmp_path: Path) -> None:
    """With one process it needs no guard, even if the kernels are not compiled yet."""
    cache = tmp_path / "cache"
    process = start_alone(tmp_path / "run", 1, 2, then=UNGUARDED, NUMBA_CACHE_DIR=str(cache))
    assert process.communicate()[1] == "" and process.returncode == 0
    assert any(cache.rglob("*.nbi"))
    assert len(Links.load(tmp_path / "run" / "links.npz")) == 6


def test_a_script_with_processes_needs_its_guard(tmp_path: Path) -> None:
    """It says so, and a process that runs the script once more does not do its work."""
    folder = tmp_path / "run"
    process = start_alone(folder, 2, 2, then=UNGUARDED)
    told = process.communicate(timeout=120)[1]
    assert process.returncode == 1 and "the script needs: if __name__ == '__main__':" in told
    assert (folder / "work").is_dir() and not (folder / "links.npz").exists()


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
def test_killed_and_gone_on_with(
    link: Callable[..., Links], anywhere: bytes, tmp_path: Path
) -> None:
    """By kill -9, which leaves no time to tell the others: they end by themselves."""
    folder = tmp_path / "run"
    process = start_alone(folder, 2, 8, pause=0.2)
    deadline = time.monotonic() + 120.0
    while len(list((folder / "work").glob("batch_*.npz"))) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.002)
    tasks = Path(f"/proc/{process.pid}/task").iterdir()
    children = [pid for task in tasks for pid in (task / "children").read_text().split()]
    process.send_signal(signal.SIGKILL)
    assert process.stderr is not None
    process.stderr.close()
    process.wait(timeout=60)
    assert children
    assert not (folder / "links.npz").exists()
    while any(alive(pid) for pid in children):
        assert time.monotonic() < deadline, "a process waits for a parent that is no more"
        time.sleep(0.01)
    done = len(list((folder / "work").glob("batch_*.npz")))
    assert 2 <= done < BATCHES
    link(folder, jobs=2)
    assert (folder / "links.npz").read_bytes() == anywhere


def alive(pid: str) -> bool:
    """Whether a process runs: not one that only waits to be forgotten."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state not in "ZX"


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster of two workers."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=":0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_the_same_bytes(
    link: Callable[..., Links], anywhere: bytes, tmp_path: Path, scheduler: str
) -> None:
    """And it goes on with what was done here."""
    link(tmp_path / "all", scheduler=scheduler)
    assert (tmp_path / "all" / "links.npz").read_bytes() == anywhere
    with pytest.raises(StopError):
        link(tmp_path / "rest", jobs=2, progress=stop_after(40))
    told: list[int] = []
    link(tmp_path / "rest", scheduler=scheduler, progress=lambda done, _: told.append(done))
    assert 40 <= told[0] < PAIRS and told[-1] == PAIRS
    assert (tmp_path / "rest" / "links.npz").read_bytes() == anywhere


def test_a_cluster_that_is_left_can_be_come_back_to(
    link: Callable[..., Links], anywhere: bytes, tmp_path: Path, scheduler: str
) -> None:
    with pytest.raises(StopError):
        link(tmp_path, scheduler=scheduler, progress=stop_after(8))
    link(tmp_path, scheduler=scheduler)
    assert (tmp_path / "links.npz").read_bytes() == anywhere


def test_a_cluster_without_workers(
    link: Callable[..., Links], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, protocol="tcp", host="127.0.0.1",
            dashboard_address=":0", silence_logs=logging.CRITICAL,
        ) as cluster,
        pytest.raises(OSError, match=r"^scheduler: tcp://127.* has no workers"),
    ):  # fmt: skip
        link(tmp_path, scheduler=cluster.scheduler_address)


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "nowhere", "http://127.0.0.1:1", "tls://127.0.0.1:1"]
)
def test_a_scheduler_that_does_not_answer(
    address: str, link: Callable[..., Links], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("pflut.mapping.cluster.TIMEOUT", 0.5)
    with pytest.raises(OSError, match=f"^scheduler: no answer from {address}: "):
        link(tmp_path / "run", scheduler=address)
    assert not (tmp_path / "run").exists()


def test_dask_is_an_extra(
    link: Callable[..., Links], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"pip install 'pflut\[cluster\]'"):
        link(tmp_path, scheduler="tcp://127.0.0.1:8786")


def test_what_fails_on_a_worker_fails_here(
    features: list[Features], link: Callable[..., Links], tmp_path: Path, scheduler: str
) -> None:
    short = replace(features[-1], descriptors=features[-1].descriptors[:, :16])
    many = [*features, *[features[0][:0]] * (BLOCK - COUNT), short, short]
    with pytest.raises(ValueError, match="descriptors: expected one kind, got"):
        link(tmp_path, features=many, scheduler=scheduler)


def test_a_scheduler_that_ends_half_way(
    link: Callable[..., Links], anywhere: bytes, tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0",
        silence_logs=logging.CRITICAL,
    )  # fmt: skip

    def end(done: int, _: int) -> None:
        if done >= 8:
            cluster.close()

    with pytest.raises(OSError, match=r"^scheduler: lost tcp://127.*; what is done is kept"):
        link(tmp_path, scheduler=cluster.scheduler_address, progress=end)
    assert len(list((tmp_path / "work").glob("batch_*.npz"))) < BATCHES
    link(tmp_path, jobs=2)
    assert (tmp_path / "links.npz").read_bytes() == anywhere
