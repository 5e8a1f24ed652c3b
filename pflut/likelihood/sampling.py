"""Blocks of simulated correspondences over threads: the same samples whatever their number."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TypeVar

Progress = Callable[[int, int], None]
Counts = TypeVar("Counts")

BATCH = 8


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def count_blocks(
    num_blocks: int,
    make: Callable[[], Counts],
    work: Callable[[int, Counts], None],
    *,
    num_threads: int | None = None,
    progress: Progress | None = None,
) -> list[Counts]:
    """Count blocks of samples in threads.

    Parameters
    ----------
    num_blocks : int
    make : callable
        Makes empty counts; called once a thread.
    work : callable
        Called as ``work(block, counts)`` to add a block's samples to them. Whatever it draws must
        depend on the block's number alone.
    num_threads : int, optional
        Default: every core that the process may use.
    progress : callable, optional
        Called as ``progress(blocks_done, num_blocks)``.

    Returns
    -------
    list
        The counts of every thread, to be added; whole numbers in any order give the same.

    Raises
    ------
    ValueError
        If the number of threads is not positive.
    """
    if num_threads is not None and num_threads < 1:
        raise ValueError(f"num_threads: expected at least 1, got {num_threads}")
    threads = max(1, min(num_threads or available_cores(), num_blocks))

    def batch(first: int, last: int, counts: Counts) -> Counts:
        for block in range(first, last):
            work(block, counts)
        return counts

    idle = [make() for _ in range(threads)]
    done = started = 0
    with ThreadPoolExecutor(threads) as pool:
        running = {}
        try:
            while done < num_blocks:
                while idle and started < num_blocks:
                    last = min(started + BATCH, num_blocks)
                    running[pool.submit(batch, started, last, idle.pop())] = last - started
                    started = last
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    done += running.pop(future)
                    idle.append(future.result())
                    if progress is not None:
                        progress(done, num_blocks)
        finally:
            for future in running:
                future.cancel()
    return idle
