"""All pairs in this process: in batches, gone on with where they were left."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from along_a_line import (
    BATCHES,
    COUNT,
    PAIRS,
    StopError,
    seen_along_a_line,
    stop_after,
)

from pflut.datasets import Dataset
from pflut.features import FeatureCache, FeatureExtractor, Features
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import dataset_features
from pflut.mapping.feature_blocks import BLOCK
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.mapping.pair_batches import PairBatches
from pflut.mapping.pair_linker import LinkOptions, PairLinker
from pflut.mapping.proposals import all_of


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


def test_a_block_in_the_dark_beside_others(
    features: list[Features], link: Callable[..., Links], tmp_path: Path
) -> None:
    many = [*[features[0][:0]] * BLOCK, *features[1:4]]
    links = link(tmp_path, features=many, max_candidates=1, batch_size=100)
    seen = (links.indices >= BLOCK).all(axis=1)
    assert links.num_matches[seen].min() > 20 and links.num_matches[~seen].max() == 0


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
