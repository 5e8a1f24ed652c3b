"""Batches of pairs on a cluster of dask: its workers get features and give links."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.mapping.feature_blocks import BLOCK, FeatureBlock
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import PairBatches
from pflut.mapping.pair_linker import PairLinker

AHEAD = 3
"""Batches that wait at the scheduler for each thread of a worker."""
TIMEOUT = 30.0
"""Seconds until a scheduler that does not answer is given up."""


def on_cluster(
    scheduler: str, batches: PairBatches, linker: PairLinker, missing: list[int]
) -> Iterator[int]:
    """Do batches on a cluster; their files are written here.

    Each block of features is sent to the cluster once, when the first batch needs it; its workers
    hand it on to each other.

    Parameters
    ----------
    scheduler : str
        Address of a scheduler of dask.distributed.
    batches : PairBatches
    linker : PairLinker
    missing : list of int
        The batches to do.

    Yields
    ------
    int
        The number of each batch that is done and kept.

    Raises
    ------
    OSError
        If the scheduler does not answer, or a worker ends again and again.
    ImportError
        If dask.distributed is not installed.
    """
    try:
        import distributed
    except ImportError:
        raise ImportError(
            "scheduler: expected dask.distributed, got none; pip install 'pflut[cluster]'"
        ) from None

    try:
        client = distributed.Client(scheduler, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OSError(f"scheduler: no answer from {scheduler}: {error}") from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise OSError(f"scheduler: {scheduler} has no workers")
        compiled = client.run(linker.warm_up)
        restarted = [worker for worker, some in compiled.items() if some]
        if restarted:
            # what a process computes with kernels that it has compiled itself differs in last
            # digits; a worker without a nanny goes on with them
            with suppress(ValueError):
                client.restart_workers(restarted, timeout=TIMEOUT)
        (shared,) = client.scatter([linker], broadcast=True, hash=False)
        sent: dict[int, Any] = {}

        def submitted(number: int) -> Any:
            pairs = batches[number]
            needed = np.unique(pairs // BLOCK).tolist()
            for block in needed:
                if block not in sent:
                    sent[block] = client.scatter(batches.block(block), hash=False)
            parts = [sent[block] for block in needed]
            return client.submit(_link, number, shared, pairs, needed, *parts, pure=False)

        waiting = iter(missing)
        first = [submitted(number) for number in islice(waiting, AHEAD * threads)]
        running = distributed.as_completed(first, loop=client.loop)
        try:
            for future in running:
                number, links = future.result()
                links.save(batches.file(number))
                for following in islice(waiting, 1):
                    running.add(submitted(following))
                yield number
        except distributed.KilledWorker as error:
            raise OSError(f"scheduler: workers of {scheduler} ended: {error}") from None


def _link(
    number: int,
    linker: PairLinker,
    pairs: NDArray[np.int64],
    numbers: list[int],
    *blocks: FeatureBlock,
) -> tuple[int, Links]:
    """Do a batch on a worker."""
    at = dict(zip(numbers, blocks, strict=True))
    found = {}
    for image in np.unique(pairs).tolist():
        block, place = divmod(image, BLOCK)
        found[image] = at[block].image(place)
    return number, linker(found, pairs)
