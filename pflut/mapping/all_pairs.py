"""Link all pairs of many images, in batches; what a folder holds already is not done again.

The folder of a run holds ``settings.json``, and in ``work/`` the features in blocks, the pairs, and
a file for each batch that is done. In the end they become ``links.npz``, the same bytes whatever
the number of processes or machines and wherever the run was interrupted. One thing may change last
digits: a process that has compiled the kernels itself, as the first one after an installation does.
With more than one process none of those that work has.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import checksum, replacing
from pflut._jobs import in_processes, refuse_while_importing, same_settings
from pflut.datasets.base import Dataset
from pflut.features import FeatureCache, FeatureExtractor, Features
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.cluster import check_cluster, on_cluster
from pflut.mapping.feature_blocks import SCALE, digest_of, in_blocks
from pflut.mapping.link_model import LinkModel, default_link_model
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import BATCH, PairBatches
from pflut.mapping.pair_linker import LinkOptions, PairLinker
from pflut.mapping.proposals import alike, all_of, image_signatures

Progress = Callable[[int, int], None]


def dataset_features(
    dataset: Dataset,
    extractor: FeatureExtractor | None = None,
    *,
    cache: FeatureCache | None = None,
    progress: Progress | None = None,
) -> Iterator[Features]:
    """Give the features of a dataset's images one after the other, as `all_pairs` takes them.

    Parameters
    ----------
    dataset : Dataset
    extractor : FeatureExtractor, optional
        Default: `FeatureExtractor` of the dataset's camera and masks.
    cache : FeatureCache, optional
        Features are looked up there, and kept.
    progress : callable, optional
        Called as ``progress(images_done, images)``.

    Yields
    ------
    Features

    Raises
    ------
    ValueError
        If an image does not decode.
    """
    if extractor is None:
        extractor = FeatureExtractor(
            dataset.camera, mask_elevation=dataset.mask_elevation, mask=dataset.mask
        )
    for index in range(len(dataset)):
        image = dataset.image(index)
        yield extractor(image) if cache is None else cache(extractor, image)
        if progress is not None:
            progress(index + 1, len(dataset))


def all_pairs(
    features: Iterable[Features],
    folder: str | os.PathLike[str],
    table: LikelihoodTable | None = None,
    *,
    pairs: ArrayLike | None = None,
    max_candidates: int | None = None,
    neighbours: int = 1,
    options: LinkOptions | None = None,
    link_model: LinkModel | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    batch_size: int | None = None,
    progress: Progress | None = None,
) -> Links:
    """Link the pairs of many images.

    Parameters
    ----------
    features : iterable of Features
        Of the images in the order of time; taken one after the other, and not kept in memory.
    folder : path
        Gets each batch of links as soon as it is done, and in the end ``links.npz``. A run that was
        interrupted, even by kill -9, goes on where it was.
    table : LikelihoodTable, optional
        Default: `LikelihoodTable.default`.
    pairs : array_like of shape (n, 2), optional
        Which ones, the smaller index first. Default: what the next two say.
    max_candidates : int, optional
        Images that are matched with an image: those that look most like it. Default: all.
    neighbours : int
        With max_candidates the images so many before and after an image are matched with it in
        any case.
    options : LinkOptions, optional
    link_model : LinkModel, optional
        That judges evidence of this table. Default: `default_link_model` of the table, for
        panoramas.
    jobs : int
        Processes; 1 works in this one. With more, a script that calls this needs the usual
        ``if __name__ == "__main__":``.
    scheduler : str, optional
        Address of a scheduler of dask.distributed (``tcp://host:8786``): its workers do the work
        instead. They get the features from here, and need pflut, but no file of this machine.
    batch_size : int, optional
        Pairs that are kept together; of those that are not, the work is lost where a run is killed.
        Default: 500.
    progress : callable, optional
        Called as ``progress(pairs_done, pairs)``.

    Returns
    -------
    Links
        In the order of their images. The same on machines with the same kind of processor, up to
        last digits with one process that has compiled kernels itself.

    Raises
    ------
    ValueError
        If an option is out of its range, or a pair is none; no link model comes with pflut for
        the table; or the folder holds links of other features, pairs or options.
    OSError
        If a file cannot be written, a process is ended from outside, or the scheduler does not
        answer or is lost.
    ImportError
        If a scheduler is given and dask.distributed is not installed.
    """
    table = table or LikelihoodTable.default()
    linker = PairLinker(
        table=table,
        options=options or LinkOptions(),
        link_model=link_model or default_link_model(table),
    )
    batch_size = BATCH if batch_size is None else batch_size
    for name, value, least in (
        ("batch_size", batch_size, 1),
        ("jobs", jobs, 1),
        ("max_candidates", max_candidates, 0),
        ("neighbours", neighbours, 0),
    ):
        if value is not None and value < least:
            raise ValueError(f"{name}: expected at least {least}, got {value}")
    if jobs > 1:
        refuse_while_importing("all_pairs")
    target = Path(folder)
    if scheduler is not None and not (target / "links.npz").is_file():
        # before the features, which take long
        check_cluster(scheduler)
    work = target / "work"
    begun = (target / "settings.json").is_file()
    if not begun:
        work.mkdir(parents=True, exist_ok=True)
    blocks, num_images = _stored(features, work, write=not begun)
    wanted = None if pairs is None else _checked(pairs, num_images)
    settings = {
        "features": digest_of(blocks),
        "num_images": num_images,
        **linker.record(),
        "pairs": None if wanted is None else checksum("", {"pairs": wanted}),
        "max_candidates": max_candidates,
        # where all pairs are matched, so are neighbours
        "neighbours": None if max_candidates is None else neighbours,
        "batch_size": batch_size,
    }
    if not begun:
        if wanted is None:
            wanted = _proposed(work, blocks, num_images, max_candidates, neighbours)
        with replacing(work / "pairs.npy") as temporary:
            np.save(temporary, wanted)
    same_settings(target / "settings.json", settings, "links")
    finished = target / "links.npz"
    if not finished.is_file():
        batches = PairBatches(
            work, blocks, np.load(work / "pairs.npy", allow_pickle=False), batch_size
        )
        _run(batches, linker, jobs, scheduler, progress)
        parts = [Links.load(batches.file(number)) for number in range(len(batches))]
        Links.concatenate(parts).ordered().save(finished)
    links = Links.load(finished)
    shutil.rmtree(work, ignore_errors=True)
    return links


def _run(
    batches: PairBatches,
    linker: PairLinker,
    jobs: int,
    scheduler: str | None,
    progress: Progress | None,
) -> None:
    """Do the batches that are missing."""
    missing = batches.missing()
    done = len(batches.pairs) - sum(len(batches[number]) for number in missing)
    if progress is not None:
        progress(done, len(batches.pairs))
    if not missing:
        return
    if scheduler is not None:
        finished = on_cluster(scheduler, batches, linker, missing)
    else:
        # processes read kernels that are compiled; what one computes that has compiled them itself
        # differs in last digits, so a single batch is not done here then
        elsewhere = jobs > 1 and linker.warm_up()
        work = partial(_link_batch, batches, linker)
        finished = in_processes(work, missing, jobs=jobs, elsewhere=elsewhere)
    for number in finished:
        done += len(batches[number])
        if progress is not None:
            progress(done, len(batches.pairs))


def _link_batch(batches: PairBatches, linker: PairLinker, number: int) -> int:
    """Do a batch and write its file."""
    pairs = batches[number]
    found = {image: batches.image(image) for image in np.unique(pairs).tolist()}
    linker(found, pairs).save(batches.file(number))
    return number


def _stored(
    features: Iterable[Features], folder: Path, *, write: bool
) -> tuple[tuple[str, ...], int]:
    """Give the names of the blocks of features, which are hashes, and the number of images."""
    names: list[str] = []
    count = 0
    for block in in_blocks(features):
        names.append(block.digest)
        count += len(block)
        path = folder / f"{names[-1]}.npz"
        if write and not path.is_file():
            block.save(path)
    if count < 2:
        raise ValueError(f"features: expected those of at least 2 images, got {count}")
    return tuple(names), count


def _checked(pairs: ArrayLike, num_images: int) -> NDArray[np.int64]:
    """Give pairs in order, each once."""
    rows = np.asarray(pairs)
    if rows.ndim != 2 or rows.shape[1] != 2 or not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(f"pairs: expected whole numbers of shape (n, 2), got {rows.shape}")
    if len(rows) and (
        rows.min() < 0 or rows.max() >= num_images or (rows[:, 0] >= rows[:, 1]).any()
    ):
        raise ValueError(f"pairs: expected two of {num_images} images, the smaller index first")
    return np.unique(rows.astype(np.int64), axis=0)


def _proposed(
    folder: Path,
    blocks: tuple[str, ...],
    num_images: int,
    max_candidates: int | None,
    neighbours: int,
) -> NDArray[np.int64]:
    """Say which pairs are worth matching."""
    if max_candidates is None:
        return all_of(num_images)
    batches = PairBatches(folder, blocks, np.empty((0, 2), np.int64))

    def descriptors(image: int) -> NDArray[np.generic]:
        rows = batches.image(image).descriptors
        return rows if rows.dtype == np.uint8 else rows / np.float32(SCALE)

    return alike(image_signatures(descriptors, num_images), max_candidates, neighbours=neighbours)
