"""``pflut map places``: of a folder of links, of a dataset, without poses, and wrong input."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Run, refused

from pflut.datasets.folder import load_folder, write_folder
from pflut.mapping.links import Links
from pflut.mapping.topological_map import TopologicalMap

pytestmark = pytest.mark.usefixtures("own_folder")
OPTIONS = ("--jobs", 1, "--bins", 32)


def test_of_a_folder_of_links(run: Run) -> None:
    assert run("map", "links", "simulated-home", *OPTIONS, "--output", "links").code == 0
    outcome = run("map", "places", "links", "--output", "out")
    assert outcome.code == 0 and outcome.err == ""
    links, made = Links.load("links/links.npz"), TopologicalMap.load("out/topological_map.graphml")
    probable = links.probability >= 0.5
    assert np.array_equal(made.edges, links.indices[probable])
    lines = outcome.out.splitlines()
    assert lines[0].endswith(
        f"24 images, 276 pairs, {probable.sum()} links, {made.num_places} places"
    )
    assert lines[-1] == "results: out" and "note" not in outcome.out
    content = json.loads(Path("out/places.json").read_text())
    assert [about["place"] for about in content["places"]] == list(range(made.num_places))
    for about in content["places"]:
        assert about["images"] == [made.names[k] for k in made.members(about["place"])]
    across = made.places[made.edges][:, 0] != made.places[made.edges][:, 1]
    assert content["links_between_places"] == across.sum()
    assert made.names == tuple(json.loads(Path("links/run.json").read_text())["images"])
    assert Path("out/figures/places.png").stat().st_size > 10_000
    # a link of every probability more, and smaller places
    outcome = run(
        *("map", "places", "links", "--output", "fine", "--no-figures"),
        *("--min-probability", 0.9, "--resolution", 4),
    )
    fine = TopologicalMap.load("fine/topological_map.graphml")
    assert len(fine.edges) == (links.probability >= 0.9).sum()
    expected = TopologicalMap.from_links(links, 24, min_probability=0.9, resolution=4.0)
    assert fine.places.tolist() == expected.places.tolist() and not Path("fine/figures").exists()
    assert fine.num_places > made.num_places


def test_of_a_dataset_without_true_poses(
    run: Run, room_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = load_folder(room_folder)
    write_folder(
        Path("plain"),
        camera=room.camera,
        stamps=room.stamps[:6],
        images=(room.image(k) for k in range(6)),
        odometry=room.ground_truth[:6],
        name="Plain",
    )
    outcome = run("map", "places", "plain", *OPTIONS, "--output", "out")
    assert outcome.code == 0
    assert "Plain: 6 images, 15 pairs" in outcome.out and "drawn where odometry says" in outcome.out
    assert {path.name for path in Path("out").iterdir()} == {
        *("links.npz", "settings.json", "run.json"),
        *("places.json", "topological_map.graphml", "figures"),
    }
    # the folder holds links: it serves as such, from elsewhere too, and the dataset may be gone
    Path("elsewhere").mkdir()
    with monkeypatch.context() as patch:
        patch.chdir("elsewhere")
        again = run("map", "places", "../out", "--output", "again")
    assert again.code == 0 and "drawn where odometry says" in again.out
    # which is not written into
    outside = run("map", "places", "out", "--output", "plain", "--overwrite")
    assert outside.code == 2 and "--output: expected another folder than" in outside.err
    Path("plain").rename("gone")
    again = run("map", "places", "out", "--output", "again")
    assert again.code == 0 and "note: the dataset was not found" in again.out
    assert again.out.splitlines()[2:-1] == outcome.out.splitlines()[2:-1]
    assert Path("again/figures/places.png").stat().st_size > 10_000


def test_wrong_input(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    refused(run("map", "places", "nowhere"), "nowhere")
    for option in ("--min-probability", "--resolution"):
        assert run("map", "places", "nowhere", option, 0).code == 2
    Path("links").mkdir()
    Links.concatenate([]).save("links/links.npz")
    for content in ("{}", '{"images": null}', '{"images": ["a"]}'):
        Path("links/run.json").write_text(content)
        refused(run("map", "places", "links"), "run.json: names no images")
    Path("links/run.json").write_text('{"images": ["a", "b"], "arguments": 3, "source": 4}')
    outcome = run("map", "places", "links", "--output", "links", "--overwrite")
    assert outcome.code == 2 and "--output: expected another folder than links" in outcome.err
    wrong = ("--jobs", 1, "--bins", 32, "--no-mutual", "--images", "all", "--max-images", 2)
    outcome = run("map", "places", "links", *wrong)
    assert outcome.code == 2
    assert "--images, --max-images, --jobs, --mutual, --bins: without effect on" in outcome.err
    Path("links/links.npz").unlink()
    begun = {"features": "", "num_images": 7, "batch_size": 500}
    Path("links/settings.json").write_text(json.dumps(begun))
    refused(run("map", "places", "links"), "links: the links are not finished")
    monkeypatch.setitem(sys.modules, "networkx", None)
    refused(run("map", "places", "links", "--output", "out"), "pip install 'pflut[mapping]'")
    assert not Path("out").exists()


def test_of_links_that_the_library_made(run: Run) -> None:
    """They come without a record: images have numbers."""
    assert run("map", "links", "simulated-home", *OPTIONS, "--output", "mine").code == 0
    Path("mine/run.json").unlink()
    outcome = run("map", "places", "mine", "--output", "out")
    assert outcome.code == 0 and outcome.out.startswith("mine: 24 images, 276 pairs")
    names = TopologicalMap.load("out/topological_map.graphml").names
    assert names == tuple(map(str, range(24)))
