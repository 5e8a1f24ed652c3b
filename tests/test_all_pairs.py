"""All pairs: in batches, gone on with where they were left, in processes and on a cluster."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from world import World

from pflut.datasets import Dataset
from pflut.features import FeatureCache, FeatureExtractor, Features, match
from pflut.features.matching import similarity_scores
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs, dataset_features
from pflut.mapping.constraint import KINDS, extract_constraint
from pflut.mapping.feature_blocks import BLOCK, MAX_LENGTH, SCALE, FeatureBlock, in_blocks
from pflut.mapping.link_evidence import link_evidence
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import PairBatches
from pflut.mapping.pair_linker import LinkOptions, PairLinker
from pflut.mapping.proposals import alike, all_of, image_signatures
from pflut.posterior import pose_posterior

COUNT = 14
PAIRS = COUNT * (COUNT - 1) // 2
BATCHES = -(-PAIRS // 8)


def unit(features: Features) -> Features:
    """Make the descriptors as long as those of the extractor."""
    length = np.linalg.norm(features.descriptors, axis=1, keepdims=True)
    return replace(features, descriptors=features.descriptors / length)


def seen_along_a_line(count: int = COUNT) -> list[Features]:
    """Features of images along a line through a room, the first of them in another room."""
    rooms = [World(seed=1), World(seed=0)]
    places = np.linspace(-3.0, 3.0, count)
    return [
        unit(rooms[k > 0].look(np.array([x, 0.3 * x, 0.4 * k]), seed=k))
        for k, x in enumerate(places)
    ]


@pytest.fixture(scope="module")
def features() -> list[Features]:
    return seen_along_a_line()


@pytest.fixture
def link(features: list[Features], small_table: LikelihoodTable) -> Callable[..., Links]:
    """Link them in small batches."""

    def call(folder: Path, table: Any = small_table, **options: Any) -> Links:
        return all_pairs(
            options.pop("features", features), folder, table, **{"batch_size": 8, **options}
        )

    return call


@pytest.fixture
def whole(link: Callable[..., Links], tmp_path: Path) -> bytes:
    """The file of a run in this process that nothing interrupted."""
    link(tmp_path / "whole")
    return (tmp_path / "whole" / "links.npz").read_bytes()


@pytest.fixture(scope="module")
def anywhere(
    features: list[Features], small_table: LikelihoodTable, tmp_path_factory: pytest.TempPathFactory
) -> bytes:
    """The same by a process of its own, which reads the kernels that this one has compiled."""
    linker = PairLinker(
        table=small_table, options=LinkOptions(), link_model=LinkModel.default("panorama")
    )
    linker.warm_up()
    folder = tmp_path_factory.mktemp("anywhere") / "run"
    process = start_alone(folder, 1, 8)
    assert process.communicate()[1] == "" and process.returncode == 0
    return (folder / "links.npz").read_bytes()


class StopError(Exception):
    """Raised by a progress bar, as Ctrl-C would be."""


def stop_after(pairs: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done >= pairs:
            raise StopError

    return progress


# --- features in blocks ------------------------------------------------------------------------


def test_products_of_whole_numbers_are_exact() -> None:
    """The longest that there may be, so that a sum in another order is the same."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(300, 128))
    rows *= (MAX_LENGTH - 1e-4) / np.linalg.norm(rows, axis=1, keepdims=True)
    rows[1] = rows[0]
    none = np.zeros(300)
    block = FeatureBlock.of(
        [Features(none, none, rows.astype(np.float32), np.zeros((300, 2)), none)]
    )
    whole = block.descriptors.astype(np.int64)
    assert block.descriptors.dtype == np.int16
    assert np.abs(whole / SCALE - rows).max() <= 0.5 / SCALE + 1e-6
    exact = whole @ whole.T
    assert 2**23 < exact.max() < 2**24
    image = block.image(0)
    assert np.array_equal(similarity_scores(image, image), exact)
    assert np.array_equal(image.squared_norms, np.diag(exact))


def test_blocks_hold_the_images(features: list[Features], tmp_path: Path) -> None:
    many = [*features, *features, features[0][:0], *features]
    blocks = list(in_blocks(iter(many)))
    assert [len(block) for block in blocks] == [BLOCK, len(many) - BLOCK]
    blocks[1].save(tmp_path / "block.npz")
    read = FeatureBlock.load(tmp_path / "block.npz")
    assert read.digest == blocks[1].digest != blocks[0].digest
    for number, one in enumerate(many):
        block, place = divmod(number, BLOCK)
        image = (blocks[0], read)[block].image(place)
        assert np.array_equal(image.azimuth, one.azimuth)
        assert np.array_equal(image.elevation, one.elevation)
        difference = image.descriptors / np.float32(SCALE) - one.descriptors
        assert np.abs(difference).max(initial=0.0) < 0.51 / SCALE
    np.savez(tmp_path / "none.npz", offsets=np.zeros(1))
    with pytest.raises(ValueError, match=r"none\.npz: not a block of features"):
        FeatureBlock.load(tmp_path / "none.npz")


def test_bits_stay_bits() -> None:
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 256, (9, 32), dtype=np.uint8)
    none = np.zeros(9)
    image = FeatureBlock.of([Features(none, none, bits, np.zeros((9, 2)), none)]).image(0)
    assert image.is_binary and np.array_equal(image.descriptors, bits)


def test_descriptors_that_are_no_unit_vectors(features: list[Features]) -> None:
    longer = replace(features[0], descriptors=512 * features[0].descriptors)
    with pytest.raises(ValueError, match=r"descriptors: expected unit vectors, got .* length 512"):
        FeatureBlock.of([features[1], longer])
    shorter = replace(features[0], descriptors=features[0].descriptors[:, :16])
    with pytest.raises(ValueError, match="features: expected one kind of descriptor, got"):
        FeatureBlock.of([features[1], shorter])


def test_the_features_of_a_dataset(room_dataset: Dataset, room_cache: FeatureCache) -> None:
    told: list[tuple[int, int]] = []
    found = dataset_features(
        room_dataset, cache=room_cache, progress=lambda *counts: told.append(counts)
    )
    first = next(found)
    assert told == []  # taken one after the other
    expected = FeatureExtractor(room_dataset.camera)(room_dataset.image(0))
    assert np.array_equal(first.descriptors, expected.descriptors)
    assert len(list(found)) == 23 and told == [(k, 24) for k in range(1, 25)]


# --- which pairs -------------------------------------------------------------------------------


def test_all_pairs_are_all() -> None:
    assert all_of(4).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]


@pytest.mark.parametrize(("candidates", "neighbours"), [(0, 1), (3, 0), (3, 2), (900, 0)])
def test_the_most_alike_are_proposed(candidates: int, neighbours: int) -> None:
    """Beside the plain loop over all images, more of them than are compared at a time."""
    rng = np.random.default_rng(0)
    signatures = rng.normal(size=(300, 8)).astype(np.float32)
    expected = set()
    for image in range(300):
        similar = signatures @ signatures[image]
        similar[image] = -np.inf
        chosen = [int(k) for k in np.argsort(-similar)[: min(candidates, 299)]]
        chosen += [k for k in range(image + 1, image + neighbours + 1) if k < 300]
        expected |= {(min(image, k), max(image, k)) for k in chosen}
    pairs = alike(signatures, candidates, neighbours=neighbours)
    assert pairs.tolist() == [list(pair) for pair in sorted(expected)]


def test_images_of_one_room_are_alike() -> None:
    rooms = [World(seed=0), World(seed=1)]
    looks = [rooms[k % 2].look(np.zeros(3), seed=k, seen=0.9, clutter=5) for k in range(10)]
    signatures = image_signatures(lambda image: looks[image].descriptors, 10)
    pairs = alike(signatures, 3, neighbours=0)
    assert len(pairs) >= 15 and (np.diff(pairs) % 2 == 0).all()


@pytest.mark.parametrize("dark", [range(32), range(0, 300, 3), range(300)])
def test_images_in_the_dark_are_like_no_other(dark: range) -> None:
    """A whole block of them has descriptors of no kind; so may have all that words are made of."""
    rng = np.random.default_rng(0)
    bits = rng.normal(size=(20, 16)).astype(np.float32)
    looks = {k: bits + rng.normal(0.0, 0.1, bits.shape).astype(np.float32) for k in range(300)}
    looks |= dict.fromkeys(dark, np.empty((0, 1), np.float32))
    signatures = image_signatures(lambda image: looks[image], 300)
    assert signatures.shape[0] == 300 and not signatures[list(dark)].any()
    lengths = np.linalg.norm(np.delete(signatures, list(dark), axis=0), axis=1)
    assert lengths == pytest.approx(np.ones(300 - len(dark)), abs=1e-5)


def test_a_block_in_the_dark_beside_others(
    features: list[Features], link: Callable[..., Links], tmp_path: Path
) -> None:
    many = [*[features[0][:0]] * BLOCK, *features[1:4]]
    links = link(tmp_path, features=many, max_candidates=1, batch_size=100)
    seen = (links.indices >= BLOCK).all(axis=1)
    assert links.num_matches[seen].min() > 20 and links.num_matches[~seen].max() == 0


def test_proposals_of_less_than_none() -> None:
    for name in ("max_candidates", "neighbours"):
        with pytest.raises(ValueError, match=f"{name}: expected at least 0, got -1"):
            alike(np.zeros((3, 2), np.float32), **{"max_candidates": 1, name: -1})


# --- one pair ----------------------------------------------------------------------------------


def test_a_link_is_what_the_two_images_say(
    features: list[Features],
    small_table: LikelihoodTable,
    link: Callable[..., Links],
    tmp_path: Path,
) -> None:
    links = link(tmp_path)
    assert links.indices.tolist() == all_of(COUNT).tolist()
    block = FeatureBlock.of(features)
    for number in (20, 50, PAIRS - 1):
        left, right = links.indices[number]
        matches = match(block.image(left), block.image(right), mutual=True)
        assert links.num_matches[number] == len(matches)
        posterior = pose_posterior(matches, small_table, temperature=0.3)
        constraint, wanted = links.constraint(number), extract_constraint(posterior)
        evidence = link_evidence([matches], small_table)
        assert links.log_evidence[number] == evidence.log_evidence[0]
        assert links.probability[number] == LinkModel.default().probability(evidence)[0]
        assert constraint.kind == wanted.kind and constraint.entropy == wanted.entropy
        assert np.array_equal(constraint.mixture.means, wanted.mixture.means)


def test_images_of_two_rooms_are_not_linked(link: Callable[..., Links], tmp_path: Path) -> None:
    links = link(tmp_path)
    stranger = (links.indices == 0).any(axis=1)
    near = np.diff(links.indices)[:, 0] == 1
    assert links.probability[stranger].max() < 0.2
    assert links.probability[near & ~stranger].min() > 0.8


def test_few_matches_say_nothing(
    features: list[Features],
    small_table: LikelihoodTable,
    link: Callable[..., Links],
    tmp_path: Path,
) -> None:
    few = [features[0], features[5], features[6], features[7][:0], features[8][:1]]
    links = link(tmp_path, features=few, options=LinkOptions(min_matches=30))
    said = links.num_matches >= 30
    assert said.tolist() == [pair == [1, 2] for pair in links.indices.tolist()]
    assert {KINDS[kind] for kind in links.kind[~said]} == {"none"}
    assert links.constraint(0).mixture.uniform_weight == 1.0
    empty = (links.indices == 3).any(axis=1)
    assert (links.num_matches[empty] == 0).all() and (links.log_evidence[empty] == 0.0).all()
    assert links.probability[empty].max() < links.probability[said].min()


def test_what_is_not_linked_says_nothing(link: Callable[..., Links], tmp_path: Path) -> None:
    asked = link(tmp_path / "asked", options=LinkOptions(min_probability=0.0))
    least = float(np.median(asked.probability))
    said = link(tmp_path / "said", options=LinkOptions(min_probability=least))
    assert np.array_equal(asked.probability, said.probability)
    none = KINDS.index("none")
    assert (said.kind[said.probability < least] == none).all()
    near = said.probability >= least
    assert np.array_equal(said.entropy[near], asked.entropy[near])
    assert 0 < near.sum() < (asked.kind != none).sum()


def test_a_prior_moves_the_probability(link: Callable[..., Links], tmp_path: Path) -> None:
    odds = []
    for prior in (None, 0.01):
        links = link(tmp_path / str(prior), options=LinkOptions(prior=prior))
        odds.append(np.log(links.probability / (1.0 - links.probability))[:30])
    expected = np.log(0.01 / 0.99) + np.log(1.0 / LinkModel.default().prior - 1.0)
    assert odds[1] - odds[0] == pytest.approx(np.full(30, expected), abs=1e-6)


def test_options_out_of_range() -> None:
    for name, values in (
        ("ratio", (0.0, 1.1)),
        ("min_matches", (0,)),
        ("min_probability", (-0.1, 1.1)),
        ("temperature", (0.0,)),
        ("prior", (0.0, 1.0)),
    ):
        for value in values:
            with pytest.raises(ValueError, match=f"^{name}: expected .*got {value}"):
                LinkOptions(**{name: value})


# --- the run -----------------------------------------------------------------------------------


def test_each_batch_needs_few_blocks(tmp_path: Path) -> None:
    batches = PairBatches(tmp_path, (), all_of(5 * BLOCK), 200)
    assert sum(len(batches[number]) for number in range(len(batches))) == len(all_of(5 * BLOCK))
    needed = [len(np.unique(batches[number] // BLOCK)) for number in range(len(batches))]
    assert max(needed) <= 3


def test_some_pairs(link: Callable[..., Links], tmp_path: Path) -> None:
    every = link(tmp_path / "all")
    some = link(tmp_path / "some", pairs=[[2, 9], [0, 3], [2, 9]])
    assert some.indices.tolist() == [[0, 3], [2, 9]]
    row = every.indices.tolist().index([2, 9])
    assert some.log_evidence[1] == every.log_evidence[row]
    alone = link(tmp_path / "alike", max_candidates=2)
    assert len(alone) < PAIRS / 2
    assert {(k, k + 1) for k in range(COUNT - 1)} <= set(map(tuple, alone.indices.tolist()))


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([[0, COUNT]], f"two of {COUNT} images"),
        ([[-1, 2]], f"two of {COUNT} images"),
        ([[3, 3]], "the smaller index first"),
        ([[0.0, 1.0]], "expected whole numbers"),
        ([0, 1], "expected whole numbers"),
    ],
)
def test_pairs_that_are_none(
    pairs: Any, message: str, link: Callable[..., Links], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=f"^pairs: .*{message}"):
        link(tmp_path, pairs=pairs)


def test_one_image_has_no_pair(
    features: list[Features], link: Callable[..., Links], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="features: expected those of at least 2 images, got 1"):
        link(tmp_path, features=features[:1])


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"batch_size": 0}, "batch_size: expected at least 1, got 0"),
        ({"jobs": 0}, "jobs: expected at least 1, got 0"),
        ({"max_candidates": -1}, "max_candidates: expected at least 0, got -1"),
        ({"neighbours": -1}, "neighbours: expected at least 0, got -1"),
    ],
)
def test_what_is_out_of_range_leaves_no_folder(
    option: dict[str, int], message: str, link: Callable[..., Links], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        link(tmp_path / "run", **option)
    assert not (tmp_path / "run").exists()


def test_neighbours_count_among_some_only(link: Callable[..., Links], tmp_path: Path) -> None:
    pairs = len(link(tmp_path, neighbours=1))
    assert len(link(tmp_path, neighbours=3)) == pairs == PAIRS


def test_the_link_model_is_that_of_the_table(
    features: list[Features], link: Callable[..., Links], tmp_path: Path
) -> None:
    home = LikelihoodTable.default("home", bins=32)
    found = link(tmp_path / "home", home, pairs=[[3, 4]])
    same = link(tmp_path / "same", home, pairs=[[3, 4]], link_model=LinkModel.default("home"))
    other = link(tmp_path / "other", home, pairs=[[3, 4]], link_model=LinkModel.default())
    assert found.probability == same.probability != other.probability
    for table in (LikelihoodTable.default("perspective"), replace(home, mismatch=0.5)):
        with pytest.raises(ValueError, match=r"^link_model: expected one that judges evidence"):
            link(tmp_path / "none", table)
    assert not (tmp_path / "none").exists()


def test_progress_counts_pairs(link: Callable[..., Links], tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    link(tmp_path, progress=lambda *counts: told.append(counts))
    assert told[0] == (0, PAIRS) and told[1] == (8, PAIRS) and told[-1] == (PAIRS, PAIRS)
    assert len(told) == BATCHES + 1


def test_what_is_done_is_not_done_again(
    link: Callable[..., Links], whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    with pytest.raises(StopError):
        link(folder, progress=stop_after(40))
    kept = {path.name: path.stat().st_mtime_ns for path in (folder / "work").glob("batch_*.npz")}
    assert len(kept) == 5 and not (folder / "links.npz").exists()
    linked: list[int] = []
    call = PairLinker.__call__
    monkeypatch.setattr(
        PairLinker, "__call__", lambda self, f, p: (linked.append(len(p)), call(self, f, p))[1]
    )
    link(folder)
    assert sum(linked) == PAIRS - 40
    assert (folder / "links.npz").read_bytes() == whole
    # and the work is gone
    assert sorted(path.name for path in folder.iterdir()) == ["links.npz", "settings.json"]
    assert len(link(folder)) == PAIRS and sum(linked) == PAIRS - 40


def test_half_a_file_does_not_count(
    link: Callable[..., Links], whole: bytes, tmp_path: Path
) -> None:
    """A kill while a file is written leaves another name; what stands by its own is checked."""
    folder = tmp_path / "run"
    with pytest.raises(StopError):
        link(folder, progress=stop_after(40))
    done = folder / "work" / "batch_000001.npz"
    half = folder / "work" / ".batch_000007.0123abcd.npz"
    half.write_bytes(done.read_bytes()[:99])
    shutil.copytree(folder, tmp_path / "other")
    link(folder)
    assert (folder / "links.npz").read_bytes() == whole
    damaged = tmp_path / "other" / "work" / done.name
    damaged.write_bytes(done.read_bytes()[:-99] if done.exists() else damaged.read_bytes()[:-99])
    with pytest.raises(ValueError, match=r"batch_000001\.npz: .*damaged"):
        link(tmp_path / "other")
    damaged.unlink()
    link(tmp_path / "other")
    assert (tmp_path / "other" / "links.npz").read_bytes() == whole


def test_interrupted_before_the_first_batch(
    features: list[Features], link: Callable[..., Links], whole: bytes, tmp_path: Path
) -> None:
    def broken() -> Iterator[Features]:
        yield from features[:9]
        raise StopError

    with pytest.raises(StopError):
        link(tmp_path / "run", features=broken())
    link(tmp_path / "run")
    assert (tmp_path / "run" / "links.npz").read_bytes() == whole


def test_the_size_of_a_batch_changes_nothing(
    link: Callable[..., Links], whole: bytes, tmp_path: Path
) -> None:
    for size in (13, 1000):
        link(tmp_path / str(size), batch_size=size)
        assert (tmp_path / str(size) / "links.npz").read_bytes() == whole


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"options": LinkOptions(temperature=0.5)}, "temperature"),
        ({"options": LinkOptions(min_matches=9)}, "min_matches"),
        ({"pairs": [[0, 1]]}, "pairs"),
        ({"max_candidates": 2}, "max_candidates, neighbours"),
        ({"table": LikelihoodTable.default(bins=16)}, "table"),
        ({"table": LikelihoodTable.default("home", bins=32)}, "link_model, table"),
        (
            {
                "table": replace(LikelihoodTable.default(bins=32), mismatch=0.5),
                "link_model": LinkModel.default(),
            },
            "table",
        ),
        ({"features": seen_along_a_line()[:-1]}, "features, num_images"),
        ({"features": seen_along_a_line()[::-1]}, "features"),
    ],
)
def test_links_of_other_settings_are_not_mixed(
    change: dict[str, Any], name: str, link: Callable[..., Links], tmp_path: Path
) -> None:
    with pytest.raises(StopError):
        link(tmp_path, progress=stop_after(8))
    before = sorted((tmp_path / "work").iterdir())
    with pytest.raises(ValueError, match=f"holds links with another {name}, expected a new folder"):
        link(tmp_path, **change)
    assert sorted((tmp_path / "work").iterdir()) == before
    link(tmp_path)
    with pytest.raises(ValueError, match=f"holds links with another {name}, expected a new folder"):
        link(tmp_path, **change)


# --- processes ---------------------------------------------------------------------------------

SCRIPT = """
import sys, time
from test_all_pairs import seen_along_a_line
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import all_pairs
from pflut.mapping.pair_linker import LinkOptions, PairLinker

folder, jobs, size, pause = sys.argv[1], *map(float, sys.argv[2:])
call = PairLinker.__call__

def slowly(*arguments):
    time.sleep(pause)
    return call(*arguments)

PairLinker.__call__ = slowly
"""
GUARDED = """
if __name__ == "__main__":
    table = LikelihoodTable.default(bins=32)
    all_pairs(seen_along_a_line(), folder, table, jobs=int(jobs), batch_size=int(size))
"""
# few kernels are needed, those that are slow to compile are not
UNGUARDED = """
options = LinkOptions(min_matches=1000)
all_pairs(seen_along_a_line(4), folder, jobs=int(jobs), batch_size=int(size), options=options)
"""


def start_alone(
    folder: Path, jobs: int, size: int, *, pause: float = 0.0, then: str = GUARDED, **more: str
) -> subprocess.Popen[str]:
    """Start another Python that links the same images."""
    script = folder.with_suffix(".py")
    script.write_text(SCRIPT + then)
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), str(jobs), str(size), str(pause)],
        env={**os.environ, "PYTHONPATH": path, **more},
        stderr=subprocess.PIPE,
        text=True,
    )


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


# --- a cluster ---------------------------------------------------------------------------------


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


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "http://127.0.0.1:1"])
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
