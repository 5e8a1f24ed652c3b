"""Link all pairs of the images of rendered homes: how fast, killed half-way, and on a cluster.

    python sims/all_pairs.py [--quick] [--runs NAME ...] [--scheduler ADDRESS] [--output DIR]

Takes the images of several rendered homes as those of one drive, which makes 10^5 pairs, most of
them of places that have nothing in common. Links them (1) without interruption; (2) again, killed
by kill -9 when half of the batches are done, and gone on with; (3) on
dask workers, of this machine unless --scheduler names others. Compares the files byte by byte.

To expect: the same file each time; some milliseconds of one core a pair, most of them for the
matching of some 900 with 900 features.

Prints also what is left out if each image is matched only with those that look most like it:
the share of the linked pairs among the proposed ones, and of the pairs that are proposed.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from tqdm import tqdm

from pflut.datasets.simulated_home import load_simulated_home
from pflut.features import FeatureCache, Features
from pflut.likelihood.sampling import available_cores
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs, dataset_features
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import BATCH
from pflut.mapping.proposals import alike, image_signatures
from pflut.replay.tables import COMMON_BINS

CANDIDATES = (5, 10, 20, 40, 80)


def images_of_homes(seed: int, count: int) -> Iterator[Features]:
    """Give the features of so many images of rendered homes, of one home after the other."""
    cache = FeatureCache()
    homes = (
        dataset_features(load_simulated_home(home), cache=cache) for home in itertools.count(seed)
    )
    return itertools.islice(itertools.chain.from_iterable(homes), count)


def link(arguments: argparse.Namespace, folder: Path, *, scheduler: str | None = None) -> Links:
    """Link the pairs in this process and its children, with a bar."""
    with tqdm(unit="pair", desc=folder.name, disable=None) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return all_pairs(
            images_of_homes(arguments.seed, arguments.images),
            folder,
            LikelihoodTable.default(bins=arguments.bins),
            jobs=arguments.jobs,
            scheduler=scheduler,
            progress=progress,
        )


def timed(arguments: argparse.Namespace, folder: Path, *, scheduler: str | None = None) -> Links:
    """Link the pairs and print how long it took, the features given."""
    for _ in images_of_homes(arguments.seed, arguments.images):
        pass  # computed and kept before the clock starts
    shutil.rmtree(folder, ignore_errors=True)
    start, before = time.perf_counter(), os.times()
    links = link(arguments, folder, scheduler=scheduler)
    seconds, after = time.perf_counter() - start, os.times()
    # those of the processes that have ended, too; a cluster's are not known here
    used = sum(after[:4]) - sum(before[:4])
    print(
        f"{folder.name:14}{len(links):>9} pairs {seconds:>8.1f} s {len(links) / seconds:>8.0f} "
        f"pairs/s"
        + (f" {1e3 * used / len(links):>8.2f} ms of one core a pair" if not scheduler else "")
    )
    return links


def killed_half_way(arguments: argparse.Namespace, folder: Path) -> int:
    """Start the same in another process, kill it, and give how many pairs it leaves."""
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, __file__, "--only", str(folder)]
    for name in ("seed", "images", "bins", "jobs"):
        command += [f"--{name}", str(getattr(arguments, name))]
    # what the tracker of its semaphores says when it finds them left behind helps nobody
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    half = arguments.images * (arguments.images - 1) // 4
    while done(folder) < half:
        if process.poll() is not None:
            raise RuntimeError(f"{folder}: ended before it was killed, expected more images")
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    return done(folder)


def done(folder: Path) -> int:
    """Count the pairs that a run has kept."""
    return BATCH * len(list((folder / "work").glob("batch_*.npz")))


def print_proposals(arguments: argparse.Namespace, links: Links) -> None:
    """Say which of the linked pairs look alike."""
    descriptors = [f.descriptors for f in images_of_homes(arguments.seed, arguments.images)]
    signatures = image_signatures(descriptors.__getitem__, len(descriptors))
    linked = set(map(tuple, links.indices[links.probability > 0.5].tolist()))
    print(f"{len(linked)} pairs are linked (probability above 0.5); proposed of them")
    for candidates in CANDIDATES:
        pairs = set(map(tuple, alike(signatures, candidates).tolist()))
        found = len(linked & pairs) / max(len(linked), 1)
        share = len(pairs) / len(links)
        print(
            f"  {candidates:>3} candidates an image {100 * found:>5.1f} % "
            f"({100 * share:.1f} % of all pairs)"
        )


def main() -> None:
    """Run all of them and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=450, help="(default: %(default)s)")
    parser.add_argument("--seed", type=int, default=100, help="of the first home")
    parser.add_argument("--bins", type=int, default=COMMON_BINS, help="(default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=available_cores(), help="processes")
    parser.add_argument("--quick", action="store_true", help="120 images")
    parser.add_argument(
        "--runs",
        nargs="+",
        choices=("uninterrupted", "killed", "cluster"),
        default=["uninterrupted", "killed", "cluster"],
        help="the files of former runs are compared, too",
    )
    parser.add_argument("--scheduler", help="of a dask cluster (default: a local one)")
    parser.add_argument("--only", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--output", type=Path, default=Path("results/all_pairs"))
    arguments = parser.parse_args()
    if arguments.quick:
        arguments.images = 120
    if arguments.only is not None:
        link(arguments, arguments.only)
        return
    output: Path = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    if "uninterrupted" in arguments.runs:
        print_proposals(arguments, timed(arguments, output / "uninterrupted"))
    if "killed" in arguments.runs:
        kept = killed_half_way(arguments, output / "killed")
        print(f"killed        {kept:>9} pairs are kept")
        start = time.perf_counter()
        rest = len(link(arguments, output / "killed")) - kept
        print(f"gone on with  {rest:>9} pairs {time.perf_counter() - start:>8.1f} s")
    if "cluster" in arguments.runs:
        if arguments.scheduler:
            timed(arguments, output / "cluster", scheduler=arguments.scheduler)
        else:
            import distributed

            with distributed.LocalCluster(
                n_workers=arguments.jobs, threads_per_worker=1, dashboard_address=":0"
            ) as cluster:
                timed(arguments, output / "cluster", scheduler=cluster.scheduler_address)
    files = sorted(output.glob("*/links.npz"))
    digests = [sha256(path.read_bytes()).hexdigest() for path in files]
    for path, digest in zip(files, digests, strict=True):
        print(f"{path.parent.name:14}{digest}")
    print("all files are the same" if len(set(digests)) == 1 else "the files DIFFER")
    raise SystemExit(len(set(digests)) != 1)


if __name__ == "__main__":
    main()
