"""``pflut map links``: what it prints and writes, gone on with, and wrong input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import Run, refused

from pflut.cli.progress import Bars
from pflut.datasets.simulated_home import load_simulated_home
from pflut.likelihood.dense import DenseTable
from pflut.mapping.constraint import KINDS
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links

pytestmark = pytest.mark.usefixtures("own_folder")
LINK = ("map", "links", "simulated-home", "--jobs", 1, "--bins", 32, "--output", "out")


def test_all_images_of_a_home(run: Run) -> None:
    outcome = run(*LINK)
    assert outcome.code == 0 and outcome.err == ""
    lines = outcome.out.splitlines()
    assert lines[0].endswith("24 images, 276 pairs") and lines[-1] == "results: out"
    links = Links.load("out/links.npz")
    counted = {words[0]: list(map(int, words[1:])) for words in map(str.split, lines[3:8])}
    for code, kind in enumerate(KINDS):
        those = links.kind == code
        assert counted[kind] == [those.sum(), (links.probability[those] >= 0.5).sum()]
    assert counted["all"] == [276, (links.probability >= 0.5).sum()]
    record = json.loads(Path("out/run.json").read_text())
    assert len(record["images"]) == 24 and record["arguments"]["bins"] == 32
    # it is there, and not done again
    before = Path("out/links.npz").stat().st_mtime_ns
    assert run(*LINK).out == outcome.out
    assert Path("out/links.npz").stat().st_mtime_ns == before


def test_those_that_look_alike(run: Run) -> None:
    outcome = run(*LINK, "--max-candidates", 2, "--neighbours", 2)
    assert outcome.code == 0
    pairs = set(map(tuple, Links.load("out/links.npz").indices.tolist()))
    assert 45 <= len(pairs) <= 93
    assert {(k, k + gap) for gap in (1, 2) for k in range(24 - gap)} <= pairs


@pytest.mark.parametrize("action", ["links", "build", "places"])
def test_interrupted_and_gone_on_with(
    run: Run, action: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = ("--images", "all", "--simulate-odometry") if action == "build" else ()
    command = ("map", action, *LINK[2:], *images)
    call = Bars.__call__

    def stop(bars: Bars, stage: str, done: int, total: int) -> None:
        call(bars, stage, done, total)
        if stage == stopped and done >= 1:
            raise KeyboardInterrupt

    # seen by a default, too
    monkeypatch.setattr("pflut.mapping.all_pairs.BATCH", 100)
    monkeypatch.setattr(Bars, "__call__", stop)
    stopped = "features"
    outcome = run(*command)
    assert outcome.code == 130 and outcome.out == ""
    assert outcome.err.strip() == (
        "pflut: interrupted: no pair is kept in out; the same command with --output out goes on"
    )
    stopped = "pairs"
    outcome = run(*command, "--overwrite")
    assert outcome.code == 130
    assert outcome.err.strip() == (
        "pflut: interrupted: 100 of 276 pairs are kept in out; the same command with --output out, "
        "without --overwrite, goes on"
    )
    stopped = ""
    assert run(*command).code == 0 and len(Links.load("out/links.npz")) == 276


@pytest.mark.parametrize(("choice", "count"), [("references", 12), ("queries", 5)])
def test_some_of_the_images(run: Run, choice: str, count: int) -> None:
    images = ("--images", choice, "--max-images", count, "--max-candidates", 1)
    outcome = run(*LINK, *images)
    assert f": {count} images, {len(Links.load('out/links.npz'))} pairs" in outcome.out
    names = json.loads(Path("out/run.json").read_text())["images"]
    home = load_simulated_home()
    indices = {"references": home.reference_indices, "queries": home.query_indices}[choice]
    assert names == [home.image_paths[k].name for k in indices[:count]]
    # the map is of the same images
    assert run("map", "places", "out", "--output", "places", "--no-figures").code == 0
    refused(run(*LINK[:-1], "again", "--max-images", 1), "expected 2 images, got 1")


@pytest.mark.parametrize("action", ["links", "places", "build"])
def test_overwriting_begins_anew(run: Run, action: str) -> None:
    """It leaves what is not of a map, and nothing of the former run, finished or not."""
    command = ("map", action, *LINK[2:], "--max-images", 4)
    command += ("--no-figures",) * (action != "links")
    Path("out").mkdir()
    Path("out/precious").touch()
    refused(run(*command), "out: holds something already, expected a new folder or --overwrite")
    assert run(*command, "--overwrite").code == 0
    links = Path("out/links.npz").read_bytes()
    written = {path.name for path in Path("out").rglob("*")}
    # of other options, and of another action: both are refused without it
    refused(run(*command, "--prior", 0.01), "out: holds links with another prior")
    for name in ("figures/map.png", "places.json", "work/batch_000000.npz", "work/mine.txt"):
        Path("out", name).parent.mkdir(exist_ok=True)
        Path("out", name).touch()
    assert run(*command, "--overwrite", "--prior", 0.01).code == 0
    assert Path("out/links.npz").read_bytes() != links
    assert {path.name for path in Path("out").rglob("*")} - written <= {"work", "mine.txt"}
    assert Path("out/places.json").exists() == (action == "places")
    # links that nobody has the settings of are not taken for those that are asked for
    Path("out/settings.json").unlink()
    assert run(*command, "--overwrite").code == 0
    assert Path("out/links.npz").read_bytes() == links and Path("out/precious").exists()


def test_a_model_by_its_name_or_from_a_file(run: Run) -> None:
    LinkModel.default("perspective").save("model.json")
    found = {}
    for model in ("perspective", "model.json", "panorama"):
        options = ("--max-candidates", 1, "--link-model", model)
        assert run(*LINK[:-1], f"out-{model}", *options).code == 0
        found[model] = Links.load(f"out-{model}/links.npz").probability.tolist()
    assert found["perspective"] == found["model.json"] != found["panorama"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--temperature", 0.5), ("out: holds links with another temperature",)),
        (("--bins", 16), ("out: holds links with another table",)),
        (("--max-features", 50), ("out: holds links with another features",)),
        (("--prior", 0.01), ("out: holds links with another prior",)),
        (("--max-candidates", 3), ("out: holds links with another max_candidates",)),
    ],
)
def test_other_options(run: Run, change: tuple[Any, ...], words: tuple[str, ...]) -> None:
    assert run(*LINK, "--max-candidates", 1).code == 0
    refused(run(*LINK, "--max-candidates", 1, *change), *words, "expected a new folder")


def test_wrong_input(
    run: Run, small_dense_table: DenseTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused(run("map", "links", "nowhere"), "nowhere")
    refused(run(*LINK, "--scheduler", "nowhere"), "scheduler: no answer from nowhere")
    assert not Path("out").exists()
    assert run("map", "links").code == 2
    assert run(*LINK, "--neighbours", -1).code == 2
    assert run(*LINK, "--ratio", 1.5).code == 2
    assert run(*LINK, "--prior", 1.0).code == 2
    small_dense_table.save("dense.npz")
    refused(run(*LINK, "--table", "dense.npz"), "dense.npz: a dense table, expected a residual one")
    refused(
        run(*LINK, "--table", "perspective"),
        *("no link model", "expected --link-model: perspective", "far too sure on a road"),
    )
    refused(run(*LINK, "--link-model", "none.json"), "none.json")
    assert not Path("out").exists()
    Path("full").mkdir()
    Path("full/file").touch()
    refused(run(*LINK[:-1], "full"), "full: holds something already, expected a new folder")
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    refused(run(*LINK, "--scheduler", "tcp://127.0.0.1:1"), "pip install 'pflut[cluster]'")
