"""Work in processes, and folders that go on where they were left."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from pflut._jobs import in_processes, same_settings


def square(number: int) -> tuple[int, int]:
    return number * number, os.getpid()


def refuse_three(number: int) -> int:
    if number == 3:
        raise ValueError("number: expected another than 3")
    return number


def end_at_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def sleep(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


@pytest.mark.parametrize("jobs", [1, 2])
def test_all_items_are_done(jobs: int) -> None:
    done = list(in_processes(square, range(12), jobs=jobs))
    assert sorted(value for value, _ in done) == [k * k for k in range(12)]
    here = {pid == os.getpid() for _, pid in done}
    assert here == {jobs == 1}
    assert list(in_processes(square, [], jobs=jobs)) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_fails_in_a_process_fails_here(jobs: int) -> None:
    with pytest.raises(ValueError, match=r"^number: expected another than 3$"):
        list(in_processes(refuse_three, range(6), jobs=jobs))
    assert not multiprocessing.active_children()


def test_a_process_that_is_killed_does_not_leave_us_waiting() -> None:
    with pytest.raises(OSError, match="a process ended before its work was done"):
        list(in_processes(end_at_three, range(6), jobs=2))
    assert not multiprocessing.active_children()


def test_closing_ends_the_processes_at_once() -> None:
    results = in_processes(sleep, [0.0, 60.0, 60.0], jobs=2)
    start = time.monotonic()
    assert next(results) == 0.0
    results.close()
    assert time.monotonic() - start < 30.0 and not multiprocessing.active_children()


def test_settings_are_written_once_and_compared(tmp_path: Path) -> None:
    path = tmp_path / "settings.json"
    settings = {"a": (1, 2), "options": {"b": 0.5, "c": None}}
    same_settings(path, settings, "drives")
    same_settings(path, settings, "drives")
    for other, names in (
        ({"a": (1, 3), "options": {"b": 0.5, "c": None}}, "a"),
        ({"a": (1, 2), "options": {"b": 0.6, "c": 1}}, "b, c"),
        ({"options": {"b": 0.5, "c": None}}, "a"),
    ):
        with pytest.raises(ValueError, match=f": holds drives with another {names}, expected a"):
            same_settings(path, other, "drives")
