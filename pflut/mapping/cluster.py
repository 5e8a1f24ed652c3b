"""Batches of pairs on a cluster of dask: its workers get features and give links."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._extras import require
from pflut.mapping.feature_blocks import BLOCK, FeatureBlock
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import PairBatches
from pflut.mapping.pair_linker import PairLinker

AHEAD = 3
"""Batches that wait at the scheduler for each thread of a worker."""
TIMEOUT = 30.0
"""Seconds until a scheduler that does not answer is given up."""
RESTART_TIMEOUT = 120.0
"""Seconds that workers have to start again."""


def check_cluster(scheduler: str) -> None:
    """Look whether a scheduler answers and has workers.

    Parameters
    ----------
    scheduler : str
        Its address.

    Raises
    ------
    OSError
        If it does not answer, or has none.
    ImportError
        If dask.distributed is not installed.
    """
    with _client(scheduler):
        pass


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
        If the scheduler does not answer or ends, or a worker ends again and again.
    ImportError
        If dask.distributed is not installed.
    """
    import distributed

    with _client(scheduler) as client, _lost_or_killed(scheduler):
        threads = sum(client.nthreads().values())
        compiled = client.run(linker.warm_up)
        restarted = [worker for worker, some in compiled.items() if some]
        if restarted:
            # what a process computes with kernels that it has compiled itself differs in last
            # digits; a worker without a nanny goes on with them, and one that takes long to come
            # back gets its work later
            with suppress(ValueError, TimeoutError):
                client.restart_workers(restarted, timeout=RESTART_TIMEOUT)
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
        for future in running:
            number, links = future.result()
            links.save(batches.file(number))
            for following in islice(waiting, 1):
                running.add(submitted(following))
            yield number


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """Give a connection to a scheduler that has workers."""
    distributed = require("distributed", extra="cluster", what="scheduler")
    try:
        # a client whose constructor refuses an address waits a minute when it is deleted
        _check_address(scheduler)
        client = distributed.Client(scheduler, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OSError(f"scheduler: no answer from {scheduler}: {error}") from None
    with client:
        if not client.nthreads():
            raise OSError(f"scheduler: {scheduler} has no workers")
        yield client


def _check_address(scheduler: str) -> None:
    """Refuse what is no address, no host that is known, or of a scheme dask is not set up for."""
    import distributed

    distributed.comm.resolve_address(scheduler)
    scheme, _ = distributed.comm.parse_address(scheduler)
    encrypted = scheme in ("tls", "wss")
    if encrypted and distributed.Security().get_connection_args("client")["ssl_context"] is None:
        raise ValueError(f"dask is not configured for {scheme}, expected its distributed.comm.tls")


@contextmanager
def _lost_or_killed(scheduler: str) -> Iterator[None]:
    """Say what has happened to a cluster instead of how it was noticed."""
    import distributed

    try:
        yield
    except distributed.KilledWorker as error:
        raise OSError(f"scheduler: workers of {scheduler} ended: {error}") from None
    # a future's, that of what waits for an answer, and that of what still wants to ask
    except (CancelledError, distributed.comm.CommClosedError, distributed.client.ClosedClientError):
        raise OSError(
            f"scheduler: lost {scheduler}; what is done is kept, and the same again goes on"
        ) from None


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
