"""The command line: what it prints and writes, its exit codes, and wrong input of every kind."""

from __future__ import annotations

import csv
import dataclasses
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import Outcome, Run, refused

from pflut import __version__
from pflut.datasets import load_folder
from pflut.features import FeatureExtractor, match_indices
from pflut.likelihood import storage
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.files import load_table
from pflut.likelihood.table import LikelihoodTable
from pflut.trajectory import read_tum

COMMAND = (sys.executable, "-c", "import sys; from pflut.cli import main; sys.exit(main())")
NO_TABLE = "not a likelihood table of pflut, or damaged"
FAST = ("--no-figures", "--particles", "1000", "--bins", "32")


pytestmark = pytest.mark.usefixtures("own_folder")


@pytest.fixture
def copied(room_folder: Path, tmp_path: Path) -> Path:
    """A copy of the room that a test may spoil."""
    return Path(shutil.copytree(room_folder, tmp_path / "room"))


# --- replay ------------------------------------------------------------------------------------


def test_replay_writes_a_results_folder(run: Run, room_folder: Path) -> None:
    outcome = run("replay", room_folder, "--particles", "1000", "--bins", "32", "--animate",
                  "--output", "out", "--max-images", "6")  # fmt: skip
    assert outcome.code == 0 and outcome.err == ""
    out = Path("out")
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert files == {
        "poses.tum",
        "groundtruth.tum",
        "odometry.tum",
        "steps.csv",
        "metrics.json",
        "timings.json",
        "run.json",
        "figures/trajectory.png",
        "figures/errors.png",
        "figures/posterior.png",
        "figures/particles.gif",
    }
    for text in ("room: 6 images, 12 references, 1000 particles, globally lost, seed 0",
                 "position error [m]", "heading error [deg]", "across track", "odometry alone",
                 "converged", "confidence", "matching references", "results: out"):  # fmt: skip
        assert text in outcome.out
    record = json.loads((out / "run.json").read_text())
    assert record["finished"] and record["seed"] == 0
    assert record["options"]["num_particles"] == 1000
    assert record["versions"]["pflut"] == __version__
    assert len(read_tum(out / "poses.tum")) == 6
    assert len((out / "steps.csv").read_text().splitlines()) == 7


def test_replay_is_reproducible_to_the_byte(run: Run, room_folder: Path) -> None:
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        run("replay", room_folder, *FAST, "--max-images", 3, "--seed", seed, "--output", name)
    for file in ("poses.tum", "metrics.json"):
        assert Path("a", file).read_bytes() == Path("b", file).read_bytes()
        assert Path("a", file).read_bytes() != Path("c", file).read_bytes()


def test_replay_of_the_default_dataset_goes_to_a_dated_folder(run: Run) -> None:
    outcome = run("replay", *FAST, "--max-images", 2, "--start", "truth")
    assert outcome.code == 0
    (folder,) = Path("results").iterdir()
    assert folder.name.endswith("_room") and f"results: {folder}" in outcome.out


def test_replay_from_a_pose(run: Run, room_folder: Path) -> None:
    truth = load_folder(room_folder).ground_truth
    assert truth is not None
    x, y, heading = truth[12]
    start = f"--start={x},{y},{np.degrees(heading)}"
    outcome = run("replay", room_folder, *FAST, "--max-images", 2, start, "--output", "out")
    assert outcome.code == 0 and "started at" in outcome.out
    error = read_tum("out/poses.tum").poses[0] - truth[12]
    assert np.hypot(*error[:2]) < 0.3


def test_replay_leaving_one_out(run: Run, room_folder: Path) -> None:
    outcome = run("replay", room_folder, *FAST, "--leave-one-out", "--max-images", 2,
                  "--search-spacing", "0.3", "--output", "out")  # fmt: skip
    assert outcome.code == 0
    assert "every image is a reference for all the others" in outcome.out
    assert "within 0.25 m and 5 deg:" in outcome.out
    assert not Path("out/odometry.tum").exists()
    metrics = json.loads(Path("out/metrics.json").read_text())
    assert metrics["success"]["count"] == 2


def test_replay_says_that_it_simulates_odometry(run: Run, copied: Path) -> None:
    (copied / "odometry.tum").unlink()
    outcome = run("replay", copied, *FAST, "--max-images", 2, "--output", "out")
    assert outcome.code == 0 and "note: odometry simulated from the ground truth" in outcome.out


def test_replay_without_ground_truth_of_the_queries(run: Run, copied: Path) -> None:
    truth = copied / "groundtruth.tum"
    truth.write_text("\n".join(truth.read_text().splitlines()[:13]) + "\n")  # the references'
    outcome = run("replay", copied, "--bins", 32, "--max-images", 2, "--output", "out")
    assert outcome.code == 0 and "no ground truth: no errors" in outcome.out
    assert not Path("out/groundtruth.tum").exists()
    assert Path("out/figures/trajectory.png").is_file()


def test_replay_with_a_table_of_its_own(
    run: Run, room_folder: Path, small_table: LikelihoodTable, small_dense_table: DenseTable
) -> None:
    small_table.save("residual.npz")
    small_dense_table.save("dense.npz")
    wanted = ("replay", room_folder, "--max-images", 1, "--output", "out", "--overwrite")

    def table(*more: object) -> dict[str, object]:
        assert run(*wanted, *more).code == 0
        found: dict[str, object] = json.loads(Path("out/run.json").read_text())["table"]
        return found

    learned = json.loads(json.dumps(small_table.learned_from))
    expected = {"file": "residual.npz", "bins": 32, "learned_from": learned}
    assert table("--table", "residual.npz") == expected
    assert table("--table", "residual.npz", "--bins", 16) == expected | {"bins": 16}
    assert table("--bins", 32) == expected | {"file": "default"}
    learned = json.loads(json.dumps(small_dense_table.learned_from))
    expected = {"file": "dense.npz", "bins": 32, "learned_from": learned}
    assert table("--table", "dense.npz") == expected
    assert table("--table", "dense.npz", "--bins", 32) == expected
    assert Path("out/figures/posterior.png").is_file()


def test_bins_of_a_dense_table_are_its_own(
    run: Run, room_folder: Path, small_dense_table: DenseTable
) -> None:
    small_dense_table.save("dense.npz")
    wanted = ("--table", "dense.npz", "--bins", 64, "--output", "out")
    for verb in (("replay", room_folder), ("simulate",)):
        refused(run(*verb, *wanted), "dense.npz: a dense table of 32 bins, it cannot have 64")
    assert not Path("out").exists()


def test_replay_with_the_papers_table(
    run: Run, room_folder: Path, small_dense_table: DenseTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is learned once, whatever files there are."""
    Path("dense").touch()
    asked = []

    def learned(*, bins: int, progress: object) -> DenseTable:
        asked.append(bins)
        return small_dense_table

    monkeypatch.setattr(DenseTable, "default", learned)
    wanted = ("--table", "dense", "--max-images", 1, "--no-figures", "--output", "out")
    assert run("replay", room_folder, *wanted).code == 0
    assert run("relpose", 0, 1, "--dataset", room_folder, "--table", "dense").code == 0
    assert asked == [128, 128]
    assert json.loads(Path("out/run.json").read_text())["table"]["file"] == "dense"


def test_replay_leaves_results_alone_unless_told(run: Run, room_folder: Path) -> None:
    Path("out").mkdir()
    Path("out/precious").touch()
    wanted = ("replay", room_folder, *FAST, "--max-images", 1, "--output", "out")
    refused(run(*wanted), "out: holds something already, expected a new folder or --overwrite")
    assert run(*wanted, "--overwrite").code == 0
    assert Path("out/precious").is_file()


def test_overwriting_leaves_nothing_of_the_former_replay(
    run: Run, room_folder: Path, copied: Path
) -> None:
    wanted = ("--bins", 32, "--particles", 500, "--max-images", 2, "--output", "out")
    assert run("replay", room_folder, *wanted, "--animate").code == 0
    assert Path("out/figures/particles.gif").is_file()
    Path("out/figures/mine.png").touch()
    truth = copied / "groundtruth.tum"
    truth.write_text("\n".join(truth.read_text().splitlines()[:13]) + "\n")  # the references'
    assert run("replay", copied, *wanted, "--no-figures", "--overwrite").code == 0
    files = {path.name for path in Path("out").rglob("*") if path.is_file()}
    kept = {"poses.tum", "steps.csv", "metrics.json", "timings.json", "run.json", "mine.png"}
    assert files == kept


def test_results_do_not_replace_the_dataset(run: Run, copied: Path) -> None:
    before = (copied / "groundtruth.tum").read_bytes()
    outcome = run("replay", copied, *FAST, "--max-images", 1, "--output", copied, "--overwrite")
    assert outcome.code == 2 and "expected another folder than" in outcome.err
    assert (copied / "groundtruth.tum").read_bytes() == before


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for a child")
def test_interrupted_replay_keeps_its_steps(room_folder: Path) -> None:
    command = [*COMMAND, "replay", str(room_folder), *FAST, "--no-cache", "--output", "out"]
    steps = Path("out/steps.csv")
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # a runner in the background may have its children ignore the signal
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        deadline = time.monotonic() + 60
        while not (steps.is_file() and steps.read_text().count("\n") >= 3):
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    rows = list(csv.DictReader(steps.read_text().splitlines()))
    assert err.decode().strip() == f"pflut: interrupted: images done: {len(rows)}, kept in out"
    poses = read_tum("out/poses.tum")
    np.testing.assert_allclose(poses.stamps, [float(row["stamp"]) for row in rows])
    np.testing.assert_allclose(poses.poses[:, 0], [float(row["x_m"]) for row in rows], rtol=1e-8)
    for name in ("groundtruth.tum", "odometry.tum"):
        assert len(read_tum(f"out/{name}")) == len(rows)
    assert 2 <= len(rows) < 12 and all(float(row["error_m"]) >= 0.0 for row in rows)
    assert not json.loads(Path("out/run.json").read_text())["finished"]


# --- relpose -----------------------------------------------------------------------------------


def test_relpose_finds_the_true_pose(run: Run, room_folder: Path) -> None:
    outcome = run("relpose", "12", "000013.png", "--dataset", room_folder, "--figure", "pair.png")
    assert outcome.code == 0 and "success     yes" in outcome.out
    rows = {line.split()[0]: line.split() for line in outcome.out.splitlines() if line}
    for name in ("heading_l", "heading_r", "rotation"):
        true = rows["truth"][rows["truth"].index(name) + 1].strip(",;")
        difference = float(rows[name][1]) - float(true)
        assert abs((difference + 180.0) % 360.0 - 180.0) < 3.0
    assert float(rows["link"][rows["link"].index("probable,") - 1]) > 0.5
    assert Path("pair.png").is_file() and Path("pair-posterior.png").is_file()


def test_relpose_compares(run: Run, room_folder: Path) -> None:
    """The table's row is what is printed above; a RANSAC finds the same pose of good matches."""
    outcome = run("relpose", "12", "13", "--dataset", room_folder, "--compare")
    above, below = outcome.out.split("\n\n")
    header, *rows = below.strip().splitlines()
    assert header.split() == [
        "heading_l",
        "heading_r",
        "rotation",
        "[deg]",
        "inliers",
        "success",
        "ms",
    ]
    assert [row.split("  ")[0] for row in rows] == [
        "likelihood",
        "2-point RANSAC",
        "3-point RANSAC",
        "8-point RANSAC",
    ]
    angles = np.array([row[16:46].split() for row in rows], float)
    for angle, name in zip(angles[0], ("heading_l", "heading_r", "rotation"), strict=True):
        assert f"{name:<12}{angle:8.2f} deg" in above
    assert np.abs((angles[1:3] - angles[0] + 180.0) % 360.0 - 180.0).max() < 3.0


def test_relpose_by_camera_file(run: Run, room_folder: Path) -> None:
    images = [room_folder / "images" / name for name in ("000012.png", "000013.png")]
    outcome = run("relpose", *images, "--camera", room_folder / "camera.toml")
    assert outcome.code == 0 and "success     yes" in outcome.out and "truth" not in outcome.out


def test_relpose_with_the_papers_table(
    run: Run, room_folder: Path, small_dense_table: DenseTable
) -> None:
    small_dense_table.save("dense.npz")
    pair = ("relpose", "12", "13", "--dataset", room_folder)
    outcome = run(*pair, "--table", "dense.npz", "--figure", "pair.png")
    assert outcome.code == 0 and "success     yes" in outcome.out
    assert Path("pair.png").is_file() and Path("pair-posterior.png").is_file()
    assert outcome.out != run(*pair).out


def test_relpose_takes_the_noise_that_the_table_has_learned(
    run: Run, room_folder: Path, default_table: LikelihoodTable
) -> None:
    pair = ("relpose", "12", "13", "--dataset", room_folder)
    as_learned = run(*pair)
    assert run(*pair, "--noise", default_table.noise).out == as_learned.out
    assert run(*pair, "--noise", "0.001").out != as_learned.out


def test_relpose_of_a_black_image_is_no_error_but_no_success(run: Run, copied: Path) -> None:
    """Zero matches."""
    cv2.imwrite("black.png", np.zeros((128, 512), np.uint8))
    outcome = run("relpose", "black.png", copied / "images/000001.png", "--camera",
                  copied / "camera.toml", "--figure", "pair.png")  # fmt: skip
    assert outcome.code == 0
    assert "features    0 and" in outcome.out and "matches     0, of which 0" in outcome.out
    assert "success     no" in outcome.out and Path("pair.png").is_file()


def test_relpose_of_one_match(run: Run, room_folder: Path) -> None:
    dataset = load_folder(room_folder)
    features = [FeatureExtractor(dataset.camera)(dataset.image(i)) for i in (0, 20)]
    _, _, scores = match_indices(*features, ratio=1.0, mutual=True)
    ratio = np.sort(scores)[:2].mean()  # between the best and the second
    outcome = run("relpose", 0, 20, "--dataset", room_folder, "--ratio", ratio)
    assert outcome.code == 0 and "matches     1, of which" in outcome.out
    assert "success     no" in outcome.out


def test_relpose_of_mismatches_only(run: Run, room_folder: Path) -> None:
    """Two images of noise: what matches, matches by chance."""
    rng = np.random.default_rng(3)
    for name in ("a.png", "b.png"):
        cv2.imwrite(name, cv2.GaussianBlur(rng.integers(0, 255, (128, 512), np.uint8), (0, 0), 2))
    outcome = run("relpose", "a.png", "b.png", "--camera", room_folder / "camera.toml",
                  "--ratio", "1", "--no-mutual")  # fmt: skip
    assert outcome.code == 0 and "success     no" in outcome.out
    assert int(outcome.out.split("matches")[1].split(",")[0]) > 50


@pytest.mark.parametrize("name", ["24", "-1", "nothere.png"])
def test_relpose_of_an_image_that_the_dataset_lacks(run: Run, room_folder: Path, name: str) -> None:
    outcome = run("relpose", "--dataset", room_folder, "--", "0", name)
    refused(outcome, f"{name}: no such image in room")


# --- lut, dataset, info ------------------------------------------------------------------------


def test_lut_build_and_info(run: Run) -> None:
    wanted = ("--bins", 16, "--samples", 200_000, "--seed", 3, "--noise", "0.02")
    outcome = run("lut", "build", "a.npz", *wanted, "--threads", 1)
    assert outcome.code == 0
    assert "a.npz: residual table from 200,000 correspondences" in outcome.out
    assert run("lut", "build", "b.npz", *wanted, "--threads", 2).code == 0
    tables = [LikelihoodTable.load(name) for name in ("a.npz", "b.npz")]
    np.testing.assert_array_equal(*(table.density for table in tables))
    np.testing.assert_array_equal(*(table.profile for table in tables))
    assert tables[0].bins == 16
    rows = described(run("lut", "info", "a.npz"))
    assert rows["kind"] == ["residual"] and rows["classes"] == ["4 of depth"]
    assert rows["noise"] == [f"{tables[0].noise:.4f} rad, of the residuals of true matches", "0.02"]
    assert rows["mismatch"] == ["90.0 % of the correspondences, beforehand", "0.9"]
    assert rows["quality"] == ["not looked at"] and rows["bins"][0].startswith("16 of heading_l")
    assert rows["seed"] == ["3"] and rows["source"] == ["simulation"]


def test_lut_build_and_info_of_the_papers_table(run: Run) -> None:
    wanted = ("--dense", "--bins", 16, "--samples", 200_000, "--seed", 3, "--noise", "0.02",
              "--mismatches", "simulated")  # fmt: skip
    outcome = run("lut", "build", "a.npz", *wanted, "--threads", 1)
    assert outcome.code == 0 and "a.npz: dense table from 200,000 corr" in outcome.out
    assert run("lut", "build", "b.npz", *wanted, "--threads", 2).code == 0
    tables = [DenseTable.load(name).log_ratio for name in ("a.npz", "b.npz")]
    np.testing.assert_array_equal(*tables)
    rows = described(run("lut", "info", "a.npz"))
    assert rows["kind"] == ["dense"] and rows["mismatches"] == ["simulated"]
    assert rows["bins"] == ["16 of r, 16 of theta - alpha_l and of phi - alpha_r"]
    assert rows["noise"] == ["0.02"] and rows["seed"] == ["3"]


def described(outcome: Outcome) -> dict[str, list[str]]:
    """Give the rows of `pflut lut info`; those of one name from the outside in."""
    assert outcome.code == 0
    rows: dict[str, list[str]] = {}
    for line in outcome.out.splitlines():
        name, _, value = line.strip().partition("  ")
        rows.setdefault(name, []).append(value.strip())
    return rows


def test_lut_build_takes_the_options_of_the_simulator(run: Run) -> None:
    assert run("lut", "build", "a.npz", "--samples", 50_000, "--classes", 2, "--scene", "box",
               "--field-of-view-deg", "80,40", "--max-turn-deg", "20", "--max-tilt-deg", "3",
               "--mismatch", "0.5", "--noise", "0.003").code == 0  # fmt: skip
    table = LikelihoodTable.load("a.npz")
    assert table.num_classes == 2 and table.mismatch == 0.5
    learned = table.learned_from["simulator"]
    assert learned["scene"] == "box" and learned["noise"] == 0.003
    assert learned["field_of_view"] == list(np.radians([80.0, 40.0]))
    assert (learned["max_turn"], learned["max_tilt"]) == (np.radians(20.0), np.radians(3.0))


def test_lut_from_a_dataset(run: Run, room_folder: Path, small_table: LikelihoodTable) -> None:
    wanted = ("--from-dataset", room_folder, "--max-distance", "0.5")
    assert run("lut", "build", "room.npz", *wanted).code == 0
    table = LikelihoodTable.load("room.npz")
    assert table.bins == 128 and table.quality is not None
    rows = described(run("lut", "info", "room.npz"))
    assert rows["source"] == ["simulation", "room, pairs within 0.5 m"]  # of the prior first
    assert rows["num_samples"] == [str(table.learned_from["num_samples"]), "64000000"]
    assert rows["quality"][0].startswith("multiplies the odds of a true match by")
    # a table fills what another one's pairs do not say
    dataclasses.replace(table, bins=20).save("prior.npz")
    assert run("lut", "build", "more.npz", *wanted, "--prior", "prior.npz", "--seed", 1).code == 0
    more = LikelihoodTable.load("more.npz")
    assert more.bins == 20 and more.learned_from["prior"] == table.learned_from
    assert more.learned_from["seed"] == 1
    assert run("lut", "info", "more.npz").code == 0


def test_the_papers_table_from_a_dataset(run: Run, room_folder: Path) -> None:
    wanted = ("--dense", "--from-dataset", room_folder, "--max-distance", "0.5")
    assert run("lut", "build", "room.npz", *wanted).code == 0
    assert DenseTable.load("room.npz").bins == 32
    assert "room, pairs within 0.5 m" in run("lut", "info", "room.npz").out
    refused(
        run("lut", "build", "more.npz", *wanted[1:], "--prior", "room.npz"),
        "room.npz: a dense table, expected a residual one",
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("build", "table.txt"), ("table.txt", ".npz")),
        (("build", "nothere/table.npz"), ("its folder does not exist",)),
        (("build", "t.npz", "--mismatch", "2"), ("mismatch", "[0, 1]")),
        (("build", "t.npz", "--bins", "2000"), ("bins: expected 4 to 1024",)),
        (("build", "t.npz", "--dense", "--bins", "1000"), ("bins: expected 4 to 512",)),
        (("build", "t.npz", "--classes", "33"), ("num_classes: expected 1 to 32",)),
        (("build", "t.npz", "--field-of-view-deg", "80,200"), ("field_of_view: expected two",)),
        (("build", "t.npz", "--from-dataset", "x", "--prior", "nothere.npz"), ("nothere.npz",)),
        (("info", "nothere.npz"), ("nothere.npz: No such file",)),
    ],
)
def test_lut_refuses(run: Run, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    refused(run("lut", *arguments), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("--from-dataset", "x", "--samples", 5, "--noise", "0.5", "--mismatches", "simulated"),
            "arguments --samples, --noise, --mismatches: without effect on a residual table from a "
            "dataset",
        ),
        (
            ("--dense", "--from-dataset", "x", "--seed", 0),
            "argument --seed: without effect on a dense table from a dataset",
        ),
        (
            ("--max-distance", 2, "--references", "all", "--mismatches", "uniform"),
            "arguments --mismatches, --max-distance, --references: without effect on a residual "
            "table from the simulator",
        ),
        (
            ("--dense", "--classes", 4, "--scene", "ball", "--prior", "default"),
            "arguments --classes, --scene, --prior: without effect on a dense table from the "
            "simulator",
        ),
        (("--max-turn-deg", 30), "argument --max-turn-deg: only allowed with --field-of-view-deg"),
        (("--field-of-view-deg", 30), "argument --field-of-view-deg: expected H,V, got '30'"),
    ],
)
def test_lut_build_refuses_what_it_would_ignore(
    run: Run, arguments: tuple[object, ...], words: str
) -> None:
    outcome = run("lut", "build", "q.npz", *arguments)
    assert outcome.code == 2 and words in outcome.err
    assert outcome.err.startswith("usage: pflut lut build ")


def test_lut_build_learns_the_table_that_comes_with_pflut(
    run: Run, default_table: LikelihoodTable
) -> None:
    """All but the number of samples, and that it has by default."""
    assert run("lut", "build", "a.npz", "--samples", 1000).code == 0
    learned = load_table("a.npz")
    assert isinstance(learned, LikelihoodTable)
    assert learned.learned_from | {"num_samples": 64_000_000} == default_table.learned_from
    assert (learned.bins, learned.mismatch) == (default_table.bins, default_table.mismatch)
    assert learned.density.shape == default_table.density.shape
    same = LikelihoodTable.from_simulation(num_samples=1000)
    np.testing.assert_array_equal(learned.density, same.density)


def test_lut_build_learns_64_million_by_default(
    run: Run, small_table: LikelihoodTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def learn(**options: object) -> LikelihoodTable:
        asked.append(options["num_samples"])
        return small_table

    monkeypatch.setattr(LikelihoodTable, "from_simulation", learn)
    assert run("lut", "build", "a.npz").code == 0
    assert asked == [small_table.learned_from["num_samples"]] == [64_000_000]


def test_dataset_info(run: Run, room_folder: Path, copied: Path) -> None:
    outcome = run("dataset", "info", room_folder, "--check")
    assert outcome.code == 0
    for text in ("equirectangular, 512 x 128", "24, all decode", "references  12",
                 "poses of 24 images", "poses of 12 images", "4 walls"):  # fmt: skip
        assert text in outcome.out
    (copied / "images/000007.png").write_bytes(b"no image")
    assert run("dataset", "info", copied).code == 0
    refused(run("dataset", "info", copied, "--check"), "000007.png", "does not decode")


def test_dataset_render_is_told_before_it_starts(run: Run, copied: Path) -> None:
    refused(run("dataset", "render", copied), "exists already and is not an empty folder")


def test_dataset_unwrap(run: Run, copied: Path) -> None:
    outcome = run("dataset", "unwrap", copied, "flat", "--width", "256")
    assert outcome.code == 0 and outcome.err == ""
    assert outcome.out == "flat: unwrapped; replay it with: pflut replay flat\n"
    assert "mask.png    " in run("dataset", "info", "flat", "--check").out
    assert run("replay", "flat", *FAST, "--max-images", 2, "--output", "out").code == 0
    relpose = ("relpose", "0", "1", "--dataset", "flat")
    every_match = run(*relpose).out
    mask = cv2.imread("flat/mask.png", cv2.IMREAD_GRAYSCALE)
    mask[:, : mask.shape[1] // 2] = 0
    cv2.imwrite("flat/mask.png", mask)
    assert run(*relpose).out != every_match
    assert "50.0 % of the pixels are used" in run("dataset", "info", "flat").out
    refused(run("dataset", "unwrap", copied, "flat"), "flat: exists already")
    refused(run("dataset", "unwrap", "nothere", "x"), "nothere: no such folder")
    (copied / "images/000007.png").write_bytes(b"no image")
    refused(run("dataset", "unwrap", copied, "x"), "000007.png", "does not decode")
    assert not Path("x").exists()


def test_info(
    run: Run, room_home_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = run("info")
    assert outcome.code == 0
    for text in (__version__, np.__version__, str(room_home_cache), "simulated-home", "OpenCV"):
        assert text in outcome.out
    assert "table           none learned" in outcome.out
    monkeypatch.setenv("PFLUT_CACHE", str(tmp_path))
    (tmp_path / "dense-16.npz").write_bytes(bytes(2_000_000))
    assert "table           dense-16.npz, 2 MB" in run("info").out


# --- wrong input -------------------------------------------------------------------------------


def spoil_undecodable(folder: Path) -> None:
    (folder / "images/000013.png").write_bytes(b"this is no image")


def spoil_empty(folder: Path) -> None:
    (folder / "images/000003.png").write_bytes(b"")


def spoil_size(folder: Path) -> None:
    cv2.imwrite(str(folder / "images/000013.png"), np.zeros((64, 64), np.uint8))


def spoil_missing_image(folder: Path) -> None:
    (folder / "images/000013.png").unlink()


def edit_poses(edit: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "groundtruth.tum"
        path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")

    return spoil


def edit_camera(text: str) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "camera.toml"
        path.write_text(text + path.read_text())

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_undecodable, ("000013.png", "does not decode")),
        (spoil_empty, ("000003.png", "does not decode")),
        (spoil_size, ("000013.png", "64 x 64", "expected the camera's 512 x 128")),
        (spoil_missing_image, ("images.txt:15", "000013.png", "missing")),
        (
            edit_poses(lambda lines: [*lines[:5], "4 nan 0 0 0 0 0 1", *lines[6:]]),
            ("groundtruth.tum:6", "not finite"),
        ),
        (
            edit_poses(lambda lines: [lines[0], lines[7], *lines[1:]]),
            ("groundtruth.tum:3", "is not after the one before it"),
        ),
        (
            edit_poses(lambda lines: [line.partition(" ")[2] for line in lines[1:]]),
            ("groundtruth.tum:1", "7 columns", "is the timestamp missing"),
        ),
        (edit_poses(lambda lines: lines[:1]), ("groundtruth.tum", "no rows")),
        (edit_camera("focal_length = 3\n"), ("camera.toml", "focal_length", "allowed")),
        (edit_camera("= ="), ("camera.toml", "not a TOML file")),
        (lambda folder: (folder / "camera.toml").unlink(), ("not recognized", "camera.toml")),
        (lambda folder: (folder / "references.txt").write_text("x.png\n"), ("x.png", "no image")),
        (lambda folder: (folder / "references.txt").write_text(""), ("no reference images",)),
    ],
)
def test_spoilt_datasets_are_refused_in_one_line(
    run: Run, copied: Path, spoil: Callable[[Path], object], words: tuple[str, ...]
) -> None:
    spoil(copied)
    refused(run("replay", copied, *FAST, "--max-images", "2", "--output", "out"), *words)


def test_opencv_adds_nothing_of_its_own(copied: Path) -> None:
    """It logs several lines about a file that begins as a PNG does and goes on otherwise."""
    (copied / "images/000000.png").write_bytes(b"\x89PNG\r\n\x1a\n and then nothing")
    done = subprocess.run(
        [*COMMAND, "replay", str(copied), *FAST], capture_output=True, text=True, check=False
    )
    refused(Outcome(done.returncode, done.stdout, done.stderr), "000000.png", "does not decode")


def test_an_all_black_image_is_no_error(run: Run, copied: Path) -> None:
    cv2.imwrite(str(copied / "images/000013.png"), np.zeros((128, 512), np.uint8))
    cv2.imwrite(str(copied / "images/000003.png"), np.zeros((128, 512), np.uint8))
    outcome = run("replay", copied, *FAST, "--max-images", 3, "--output", "out")
    assert outcome.code == 0 and outcome.err == ""
    rows = list(csv.DictReader(Path("out/steps.csv").read_text().splitlines()))
    assert rows[1]["matches"] == "0" and rows[1]["degenerate"] == "0"


@pytest.fixture
def spoilt_tables(
    own_folder: None, small_table: LikelihoodTable, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    small_table.save("good.npz")
    data = Path("good.npz").read_bytes()
    Path("truncated.npz").write_bytes(data[: len(data) // 2])
    Path("empty.npz").write_bytes(b"")
    Path("junk.npz").write_text("no table, and no archive")
    with Path("array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    np.savez("objects.npz", format=np.array([{}], dtype=object))
    cells = np.zeros((8, 8, 8), np.float32)
    cells[3, 2, 1] = np.nan
    storage.write_table("nan.npz", "dense", {"log_ratio": cells}, {})
    storage.write_table("kind.npz", "sparse", {}, {})
    np.savez("other.npz", poses=np.zeros(3))
    with monkeypatch.context() as later:
        later.setattr(storage, "VERSION", storage.VERSION + 1)
        small_table.save("later.npz")
    yield


@pytest.mark.usefixtures("spoilt_tables")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        *(
            (name, (f"error: {name}.npz: {NO_TABLE}\n",))
            for name in ("truncated", "empty", "junk", "array", "objects")
        ),
        ("nan", ("not finite",)),
        ("kind", ("a sparse table, expected a residual one",)),
        ("later", (f"version {storage.VERSION + 1}", f"expected {storage.VERSION}")),
        ("other", ("not a pflut likelihood table",)),
        ("nothere", ("No such file",)),
    ],
)
def test_spoilt_tables_are_refused_in_one_line(
    run: Run, room_folder: Path, name: str, words: tuple[str, ...]
) -> None:
    file = f"{name}.npz"
    refused(run("lut", "info", file), file, *words)
    refused(run("replay", room_folder, "--table", file, "--output", "out"), file, *words)
    refused(run("relpose", 0, 1, "--dataset", room_folder, "--table", file), file, *words)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("replay", "nothere"), ("nothere: no such dataset",)),
        (("replay", "{room}", "--references", "every:0"), ("every:N",)),
        (("replay", "{room}", "--references", "nothere.txt"), ("nothere.txt is no file",)),
        (("replay", "{room}", "--references", "every:1"), ("none is left to localize",)),
        (("relpose", "a.png", "b.png", "--camera", "nothere.toml"), ("nothere.toml",)),
        (("relpose", "nothere.png", "b.png", "--camera", "{room}/camera.toml"), ("nothere.png",)),
        (("relpose", "0", "1", "--dataset", "{room}", "--ratio", "2"), ("ratio",)),
        (("relpose", "0", "1", "--dataset", "{room}", "--noise", "-1"), ("noise",)),
        (("relpose", "0", "1", "--dataset", "{room}", "--figure", "a.xyz"), ("a.xyz",)),
        (
            ("relpose", "0", "1", "--dataset", "{room}", "--figure", "nothere/a.png"),
            ("nothere/a.png: its folder does not exist",),
        ),
        (("dataset", "info", "nothere"), ("nothere",)),
    ],
)
def test_wrong_input_is_refused_in_one_line(
    run: Run, room_folder: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    outcome = run(*(word.format(room=room_folder) for word in arguments))
    refused(outcome, *words)
    assert outcome.out == ""  # told before the work, not after


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("fly",),
        ("replay", "--particles", "0"),
        ("replay", "--particles", "many"),
        ("replay", "--temperature", "2"),
        ("replay", "--start", "here"),
        ("replay", "--start", "1,2"),
        ("replay", "--max-images", "0"),
        ("replay", "--detector", "surf"),
        ("replay", "--leave-one-out", "--simulate-odometry"),
        ("relpose", "a.png", "b.png"),
        ("lut",),
        ("lut", "build"),
        ("dataset", "render", "x", "--seed", "-1"),
        ("dataset", "unwrap", "x", "y", "--width", "0"),
    ],
)
def test_wrong_usage_exits_with_2(run: Run, arguments: tuple[str, ...]) -> None:
    outcome = run(*arguments)
    assert outcome.code == 2
    assert outcome.err.startswith("usage: pflut") and "Traceback" not in outcome.err


@pytest.mark.parametrize("verb", ["replay", "simulate", "lut build", "dataset info", "info"])
def test_unknown_options_are_told_with_the_usage_of_their_verb(run: Run, verb: str) -> None:
    needed = ("table.npz",) if verb == "lut build" else ()
    outcome = run(*verb.split(), *needed, "--colour", "red")
    assert outcome.code == 2 and outcome.err.startswith(f"usage: pflut {verb}")
    assert f"pflut {verb}: error: unrecognized arguments: --colour" in outcome.err


# --- help --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "verb",
    ["replay", "simulate", "relpose", "lut build", "lut info", "dataset info", "dataset render",
     "dataset unwrap", "info"],
)  # fmt: skip
def test_help_has_examples_and_defaults(run: Run, verb: str) -> None:
    outcome = run(*verb.split(), "--help")
    assert outcome.code == 0 and outcome.out.startswith(f"usage: pflut {verb}")
    if verb != "info":
        assert "examples:\n" in outcome.out
    # every option says something
    for line in outcome.out.splitlines():
        assert not line.rstrip().endswith("(default: )")


def test_help_imports_nothing_heavy() -> None:
    """`pflut --help` must be immediate."""
    code = (
        "import sys\n"
        "from pflut.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'numba', 'cv2', 'matplotlib', 'tqdm', 'scipy'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_version(run: Run) -> None:
    assert run("--version").out == f"pflut {__version__}\n"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of Unix")
def test_a_closed_pipe_is_no_error() -> None:
    with subprocess.Popen([*COMMAND, "info"], stdout=-1, stderr=-1) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b"" and process.wait() == 0
