"""Work that fills the cores: in processes, or here; folders that go on where they were left."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pflut._files import read_json, write_json

Item = TypeVar("Item")
Result = TypeVar("Result")

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

_work: Callable[[Any], Any] | None = None
"""What a process does; it gets it once, not with each item."""


def in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], *, jobs: int, elsewhere: bool = False
) -> Generator[Result, None, None]:
    """Do some work on many items.

    Parameters
    ----------
    work : callable
        Item -> result. With more than one process it is pickled once for each, and a script that
        calls this needs the usual ``if __name__ == "__main__":``.
    items : sequence
    jobs : int
        Processes; 1 works in this one.
    elsewhere : bool
        Whether a single process is to be another one, too.

    Yields
    ------
    Any
        The results, as they are done. When the generator is closed the processes end at once.

    Raises
    ------
    OSError
        If a process is ended from outside, as by want of memory.
    """
    if not elsewhere and (jobs == 1 or len(items) <= 1):
        yield from map(work, items)
        return
    others = set(multiprocessing.active_children())
    # spawned, not forked: threads of BLAS and OpenCV do not survive a fork
    context = multiprocessing.get_context("spawn")
    number = max(1, min(jobs, len(items)))
    # by a queue: this process would wait for ever for one that ends before it reads arguments
    handed: multiprocessing.Queue[Callable[[Item], Result]] = context.Queue()
    handed.cancel_join_thread()
    for _ in range(number):
        handed.put(work)
    with single_threaded():
        pool = ProcessPoolExecutor(number, context, _start_worker, (handed,))
        running = [pool.submit(_call, item) for item in items]
    ended = False
    try:
        for future in as_completed(running):
            yield future.result()
        ended = True
    except BrokenProcessPool:
        raise OSError("a process ended before its work was done: is the memory full?") from None
    finally:
        if not ended:
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
        pool.shutdown(cancel_futures=True)


def refuse_while_importing(name: str) -> None:
    """Refuse to start processes in one that only imports the script of the process it works for.

    Such a script lacks ``if __name__ == "__main__":``, and would do everything once more.

    Parameters
    ----------
    name : str
        Of what starts processes, for the error message.

    Raises
    ------
    RuntimeError
        If this is such a process.
    """
    # what multiprocessing itself asks, when it is too late: files have been written by then
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise RuntimeError(
            f"{name}: with more than one process the script needs: if __name__ == '__main__':"
        )


def same_settings(path: Path, settings: Mapping[str, Any], what: str) -> None:
    """Refuse to mix results of different settings in one folder.

    Parameters
    ----------
    path : Path
        A JSON file of the folder; written if it is not there.
    settings : mapping
        What makes results comparable; below "options" it may be nested.
    what : str
        Of what the settings are, for the error message: "drives".

    Raises
    ------
    ValueError
        If the folder holds results of other settings.
    """
    wanted = json.loads(json.dumps(settings))
    if not path.is_file():
        write_json(path, wanted)
        return
    found = read_json(path)
    if found != wanted:
        here, there = ({**s.get("options", {}), **s} for s in (wanted, found))
        names = sorted((set(here) | set(there)) - {"options"})
        other = [name for name in names if here.get(name) != there.get(name)]
        raise ValueError(
            f"{path.parent}: holds {what} with another {', '.join(other) or 'setting'}, expected "
            "a new folder or the same"
        )


@contextmanager
def single_threaded() -> Iterator[None]:
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


def _start_worker(handed: multiprocessing.Queue[Callable[[Any], Any]]) -> None:
    """Leave Ctrl-C to the parent, and the other cores to the other processes."""
    import cv2

    global _work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    cv2.setNumThreads(1)
    _work = handed.get()


def _end_with_parent() -> None:
    """End this process when its parent does, even by kill -9: it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(item: Any) -> Any:
    assert _work is not None  # set when the process started
    return _work(item)
