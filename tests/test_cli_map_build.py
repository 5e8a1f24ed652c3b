"""``pflut map build``: what it prints and writes, gone on with, and wrong input."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Run, refused

from pflut.datasets.base import Dataset
from pflut.datasets.folder import load_folder, write_folder
from pflut.datasets.simulated_home import load_simulated_home
from pflut.mapping.drive_images import drive_images
from pflut.mapping.g2o import read_g2o
from pflut.mapping.graph_optimizer import optimize_graph
from pflut.mapping.links import Links
from pflut.mapping.pose_graph import PoseGraph
from pflut.plot.pose_graph import plot_pose_graph
from pflut.trajectory import read_tum

pytestmark = pytest.mark.usefixtures("own_folder")
BUILD = ("map", "build", "simulated-home", "--jobs", 1, "--bins", 32, "--output", "out")
WRITTEN = {"groundtruth.tum", "links.npz", "map.g2o", "metrics.json", "odometry.tum", "poses.tum"}
WRITTEN |= {"run.json", "settings.json"}


def test_a_drive_becomes_a_map(run: Run) -> None:
    outcome = run(*BUILD, "--plain-links")
    assert outcome.code == 0 and outcome.err == ""
    lines = outcome.out.splitlines()
    drive = drive_images(load_simulated_home(), "all")
    assert f"{len(drive)} images" in lines[0] and lines[-1] == "results: out"
    files = {path.name for path in Path("out").iterdir()}
    assert files >= WRITTEN and Path("out/figures/map.png").stat().st_size > 10_000

    # the files say the same as the library
    links = Links.load("out/links.npz")
    assert len(links) == len(drive) * (len(drive) - 1) // 2
    expected = optimize_graph(PoseGraph.from_odometry(drive.odometry, links))
    poses = read_tum("out/poses.tum")
    np.testing.assert_allclose(poses.poses[:, :2], expected.poses[:, :2], atol=1e-9)
    np.testing.assert_array_equal(poses.stamps, drive.stamps)
    truth = read_tum("out/groundtruth.tum").poses
    np.testing.assert_allclose(truth[:, :2], drive.ground_truth[:, :2], atol=1e-12)
    graph = read_g2o("out/map.g2o")
    believed = len(expected.believed)
    assert len(graph) == len(drive) and len(graph.links) == len(links)
    assert len(graph.odometry) == len(drive) - 1 + believed
    metrics = json.loads(Path("out/metrics.json").read_text())
    assert metrics["images"] == len(drive) and metrics["believed"] == believed
    assert {"odometry", "pose_graph"} <= metrics.keys()
    ratio = metrics["pose_graph"]["position_m"] / metrics["odometry"]["position_m"]
    assert f"{ratio:.2f} of odometry's" in outcome.out
    record = json.loads(Path("out/run.json").read_text())
    assert record["images"] == [path.name for path in drive.image_paths]

    # the links are there, and not computed again
    before = Path("out/links.npz").stat().st_mtime_ns
    assert run(*BUILD, "--plain-links").out == outcome.out
    assert Path("out/links.npz").stat().st_mtime_ns == before


def test_other_images_with_simulated_odometry(run: Run) -> None:
    refused(run(*BUILD, "--images", "references"), "expected 2 images with odometry, got 0")
    options = ("--images", "references", "--simulate-odometry", "--no-figures", "--max-images", 5)
    outcome = run(*BUILD, *options)
    assert outcome.code == 0
    assert "note: odometry is simulated from the ground truth" in outcome.out
    assert not Path("out/figures").exists()
    assert "EDGE_SE2_HEADINGS" in Path("out/map.g2o").read_text()
    assert len(read_g2o("out/map.g2o").odometry) == 4
    first = read_tum("out/odometry.tum").poses
    assert run(*BUILD[:-1], "again", *options, "--seed", 3).code == 0
    assert np.abs(read_tum("again/odometry.tum").poses - first).max() > 1e-4


@pytest.mark.parametrize("known", [0, 1])
def test_a_drive_without_truth_is_drawn_without_a_plan(
    run: Run, room_folder: Path, monkeypatch: pytest.MonkeyPatch, known: int
) -> None:
    room = load_folder(room_folder)
    truth = np.full((6, 3), np.nan)
    truth[:known] = room.ground_truth[:known]
    write_folder(
        Path("plain"),
        camera=room.camera,
        stamps=room.stamps[:6],
        images=(room.image(k) for k in range(6)),
        ground_truth=truth if known else None,
        odometry=room.ground_truth[:6] - [3.0, 1.0, 0.0],
        floor_plan=np.array([[[0.0, 0.0], [1.0, 0.0]]]),
        name="Plain",
    )
    drawn: dict[str, object] = {}

    def drawing(dataset: Dataset, poses: np.ndarray, *rest: object, **about: object) -> object:
        drawn.update(about, dataset=dataset, poses=poses)
        return plot_pose_graph(dataset, poses, *rest, **about)

    monkeypatch.setattr("pflut.plot.pose_graph.plot_pose_graph", drawing)
    outcome = run("map", "build", "plain", "--jobs", 1, "--bins", 32, "--output", "out")
    assert outcome.code == 0 and "note: no two true poses are known" in outcome.out
    assert "odometry's" not in outcome.out
    assert drawn["dataset"].floor_plan is None and drawn["ground_truth"] is None
    assert drawn["note"] == "no two true poses are known: drawn where odometry says"
    np.testing.assert_array_equal(drawn["poses"][0], room.ground_truth[0] - [3.0, 1.0, 0.0])
    assert Path("out/figures/map.png").stat().st_size > 10_000
    assert Path("out/groundtruth.tum").exists() == bool(known)


def test_a_drive_without_odometry_is_refused_with_what_may_help(
    run: Run, room_folder: Path
) -> None:
    room = load_folder(room_folder)
    write_folder(
        Path("still"),
        camera=room.camera,
        stamps=room.stamps[:3],
        images=(room.image(k) for k in range(3)),
        ground_truth=room.ground_truth[:3],
        name="Still",
    )
    message = "Still: expected odometry, or --simulate-odometry, the dataset has none"
    refused(run("map", "build", "still"), message)


def test_of_a_folder_of_links(run: Run) -> None:
    """All images are linked, and those with odometry are in the map: the same as theirs alone."""
    assert run("map", "links", "simulated-home", *BUILD[3:-1], "links").code == 0
    assert run(*BUILD).code == 0
    outcome = run("map", "build", "links", "--output", "again")
    assert outcome.code == 0 and outcome.err == ""
    for name in ("links.npz", "map.g2o", "metrics.json", "poses.tum"):
        assert Path("again", name).read_bytes() == Path("out", name).read_bytes()
    names, source = (
        [json.loads(Path(folder, "run.json").read_text())[key] for folder in ("out", "again")]
        for key in ("images", "source")
    )
    assert names[0] == names[1] and source == ["simulated-home", "simulated-home"]
    # that folder holds links, too
    assert run("map", "places", "again", "--output", "places", "--no-figures").code == 0
    outcome = run("map", "build", "links", "--jobs", 1, "--images", "all", "--max-images", 4)
    assert outcome.code == 2 and "--images, --max-images, --jobs: without effect" in outcome.err
    Path("links/run.json").unlink()
    refused(run("map", "build", "links"), "links: nothing says of which dataset its images are")


def test_wrong_input(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    refused(run("map", "build", "nowhere"), "nowhere")
    assert run("map", "build").code == 2
    assert run(*BUILD, "--images", "some").code == 2
    assert run(*BUILD, "--seed", -1).code == 2
    refusal = run(*BUILD, "--seed", 1)
    assert refusal.code == 2 and "--seed: only allowed with --simulate-odometry" in refusal.err
    refused(run(*BUILD, "--max-images", 1), "expected 2 images with odometry, got 1")
    monkeypatch.setitem(sys.modules, "scipy", None)
    refused(run(*BUILD, "--max-images", 3), "pip install 'pflut[mapping]'")
    # before the work
    assert not Path("out").exists()
