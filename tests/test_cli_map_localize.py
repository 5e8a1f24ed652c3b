"""``pflut map localize``: the same as the library, without truth, interrupted, and wrong input."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Run, refused

from pflut.cli.progress import Bars
from pflut.datasets.folder import load_folder, write_folder
from pflut.datasets.simulated_home import load_simulated_home
from pflut.features import FeatureCache
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.all_pairs import dataset_features
from pflut.mapping.node_errors import NodeErrors
from pflut.mapping.node_localizer import NodeLocalizer
from pflut.mapping.node_model import NodeModel
from pflut.mapping.node_walk import NodeWalk
from pflut.mapping.topological_map import TopologicalMap

pytestmark = pytest.mark.usefixtures("own_folder")
OPTIONS = ("--bins", 32, "--output", "out")


@pytest.fixture
def places(run: Run) -> TopologicalMap:
    """The map of the room's references, in the folder ``places``."""
    images = ("--images", "references", "--resolution", 2, "--no-figures")
    options = (*images, "--jobs", 1, "--bins", 32, "--output", "places")
    assert run("map", "places", "simulated-home", *options).code == 0
    return TopologicalMap.load("places/topological_map.graphml")


def steps(path: str = "out/steps.csv") -> list[dict[str, str]]:
    return list(csv.DictReader(Path(path).read_text().splitlines()))


def test_a_drive_in_the_map_of_another(
    run: Run, places: TopologicalMap, room_cache: FeatureCache
) -> None:
    walk = ("--hop-length", 1.5, "--kidnap-probability", 0.02, "--temperature", 0.2)
    outcome = run("map", "localize", "places", *OPTIONS, *walk)
    assert outcome.code == 0 and outcome.err == ""
    lines = outcome.out.splitlines()
    assert lines[0].endswith(f": 12 images, 12 nodes, {places.num_places} places")
    assert lines[-1] == "results: out" and "note" not in outcome.out

    # the same as by hand
    home = load_simulated_home()
    features = list(dataset_features(home, cache=room_cache))
    nodes, drive = home.reference_indices, home.query_indices
    table = LikelihoodTable.default(bins=32)
    sensor = NodeModel(places, [features[k] for k in nodes], table, temperature=0.2)
    robot = NodeLocalizer(places, sensor, walk=NodeWalk(hop_length=1.5, carried_away=0.02))
    expected = []
    for before, image in zip([None, *drive], drive, strict=False):
        if before is not None:
            robot.predict(home.odometry_between(before, image))
        expected.append(robot.update(features[image]))
    truth = home.ground_truth
    errors = NodeErrors.of(places, expected, truth[nodes], truth[drive])
    rows = steps()
    assert [row["image"] for row in rows] == [home.image_paths[k].name for k in drive]
    for k, (row, estimate) in enumerate(zip(rows, expected, strict=True)):
        assert (int(row["node"]), int(row["place"])) == (estimate.node, estimate.place)
        assert row["node_image"] == places.names[estimate.node]
        assert float(row["stamp"]) == home.stamps[drive[k]]
        assert float(row["probability"]) == pytest.approx(estimate.probability, rel=1e-9)
        assert float(row["place_probability"]) == pytest.approx(estimate.place_probability)
        assert int(row["nearest_node"]) == errors.nearest[k]
        assert float(row["distance_m"]) == pytest.approx(errors.distance[k])
        assert int(row["place_right"]) == errors.place_right[k]
    metrics = json.loads(Path("out/metrics.json").read_text())
    assert metrics == {"images": 12, "nodes": 12, "places": places.num_places} | errors.as_dict()
    assert errors.near.mean() > 0.7
    assert f"{100 * errors.near.mean():.1f} %" in lines[3]
    assert Path("out/figures/nodes.png").stat().st_size > 10_000
    record = json.loads(Path("out/run.json").read_text())
    assert record["source"] == "simulated-home" and len(record["images"]) == 12


def test_another_dataset_without_poses(
    run: Run, places: TopologicalMap, room_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its images have the names of others that the map is of; odometry is there for some."""
    room = load_folder(room_folder)
    odometry = np.array(room.odometry[12:18])
    odometry[2] = np.nan
    write_folder(
        Path("plain"),
        camera=room.camera,
        stamps=room.stamps[:6],
        images=(room.image(k) for k in range(12, 18)),
        odometry=odometry,
        name="Plain",
    )
    command = ("map", "localize", "places", "plain", *OPTIONS, "--no-figures")
    outcome = run(*command)
    assert outcome.code == 0 and "Plain: 6 images, 12 nodes" in outcome.out
    assert "note: odometry leads to 3 of 5 images" in outcome.out
    assert "note: no true poses" in outcome.out and "unknown" in outcome.out
    assert not Path("out/figures").exists()
    assert {(row["nearest_node"], row["distance_m"]) for row in steps()} == {("", "")}
    # overwritten by fewer images, and from elsewhere
    refused(run(*command), "out: holds something already, expected a new folder or --overwrite")
    Path("elsewhere").mkdir()
    with monkeypatch.context() as patch:
        patch.chdir("elsewhere")
        paths = ("../places", "../plain", "--bins", 32, "--output", "../out", "--overwrite")
        assert run("map", "localize", *paths, "--max-images", 2).code == 0
    assert len(steps()) == 2 and Path("out/figures/nodes.png").exists()
    # files of others stay
    for text in ('{"editor": 1}', "no JSON"):
        Path("out/settings.json").write_text(text)
        assert run(*command, "--overwrite", "--max-images", 2).code == 0
        assert Path("out/settings.json").read_text() == text
    Path("out/settings.json").unlink()
    # with poses it is judged, and told what was taken for granted
    few = ("--overwrite", "--no-figures", "--max-images", 2)
    outcome = run("map", "localize", "places", room_folder, *OPTIONS, *few)
    assert "note: the true poses of the map and of the dataset are taken to be" in outcome.out


def test_interrupted(run: Run, places: TopologicalMap, monkeypatch: pytest.MonkeyPatch) -> None:
    call = Bars.__call__

    def stop(bars: Bars, stage: str, done: int, total: int) -> None:
        call(bars, stage, done, total)
        if stage == "images" and done == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(Bars, "__call__", stop)
    outcome = run("map", "localize", "places", *OPTIONS)
    assert outcome.code == 130
    kept = len(steps())
    assert kept >= 3 and f"interrupted: images done: {kept}, kept in out" in outcome.err


def test_wrong_input(run: Run, places: TopologicalMap, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("map", "localize", "places", *OPTIONS)
    refused(run("map", "localize", "nowhere"), "nowhere: no topological map, expected a folder of")
    refused(run(*command[:3], "nowhere", *OPTIONS), "nowhere")
    refused(run(*command, "--images", "references"), "expected images that are not in the map")
    for option in ("--hop-length", "--temperature"):
        assert run(*command, option, 0).code == 2
    outcome = run("map", "localize", "places", "--output", "places", "--overwrite")
    assert outcome.code == 2 and "expected another folder than places" in outcome.err
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "networkx", None)
        refused(run(*command), "pip install 'pflut[mapping]'")
    about = json.loads(Path("places/run.json").read_text())
    for change, words in (
        ({"images": about["images"][::-1]}, "names other images than topological_map.graphml"),
        ({"images": about["images"][:3]}, "run.json: names no images"),
        ({"source": None}, "nothing says of which dataset its images are"),
        ({"source": "gone"}, "gone"),
    ):
        Path("places/run.json").write_text(json.dumps(about | change))
        refused(run(*command), words)
    assert not Path("out").exists()
