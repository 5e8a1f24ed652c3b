"""Figures: what they show is read back from their artists; nothing needs a display."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pflut.camera import EquirectangularPanorama
from pflut.datasets import Dataset
from pflut.evaluation import trajectory_errors
from pflut.pair_errors import PairErrors
from pflut.plot import (
    ParticleFrame,
    animate_particles,
    plot_correspondences,
    plot_errors,
    plot_medians,
    plot_pair_errors,
    plot_places,
    plot_pose_graph,
    plot_posterior,
    plot_trajectory,
    save_figure,
)

N = 6
WALLS = np.array([[[0, 0], [8, 0]], [[8, 0], [8, 4]], [[8, 4], [0, 4]], [[0, 4], [0, 0]]], float)
TRUTH = np.column_stack([np.linspace(1, 7, N), np.full(N, 2.0), np.zeros(N)])


def home(references="every:2"):
    dataset = Dataset(
        name="box",
        camera=EquirectangularPanorama(64, 32),
        stamps=np.arange(float(N)),
        image_paths=tuple(Path(f"{i}.png") for i in range(N)),
        ground_truth=TRUTH,
        floor_plan=WALLS,
    )
    return dataset.with_references(references)


def labels(figure):
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


def test_pyplot_is_never_imported():
    code = (
        "import sys, numpy as np, pflut.plot\n"
        "assert 'matplotlib' not in sys.modules\n"
        "from pflut.plot import plot_posterior, ParticleFrame\n"
        "plot_posterior(np.zeros((4, 4)))\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_trajectory_in_time():
    estimates = TRUTH + 0.1
    estimates[2] = np.nan
    figure = plot_trajectory(
        home(),
        estimates,
        TRUTH,
        particles={"image 0": np.zeros((50, 3)), "image 5": np.ones((50, 3))},
        others={"odometry": TRUTH + 0.5},
        title="box",
    )
    axes = figure.axes[0]
    assert labels(figure) == {
        "references",
        "particles, image 0",
        "particles, image 5",
        "odometry",
        "ground truth",
        "estimate",
    }
    lines = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
    np.testing.assert_array_equal(lines["estimate"], estimates[:, :2])
    np.testing.assert_array_equal(lines["ground truth"], TRUTH[:, :2])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert axes.get_aspect() == 1
    # the limits hold the map, whatever the particles do
    assert axes.get_xlim()[0] < 0 < 8 < axes.get_xlim()[1] < 9


def test_trajectory_without_order_joins_each_estimate_with_its_truth():
    estimates = TRUTH + np.array([0, 1, 0])
    estimates[1] = np.nan
    figure = plot_trajectory(home("all"), estimates, TRUTH)
    axes = figure.axes[0]
    assert labels(figure) == {"ground truth", "estimate"}
    assert not axes.get_lines()
    joined = [c.get_segments() for c in axes.collections if hasattr(c, "get_segments")][-1]
    assert len(joined) == N - 1
    np.testing.assert_array_equal(joined[0], [[1, 2], [1, 3]])


def test_a_narrow_map_has_its_legend_beside_it():
    for angle, below in ((0.0, True), (np.pi / 2, False)):
        cos, sin = np.cos(angle), np.sin(angle)
        turned = WALLS * [1.0, 0.3] @ np.array([[cos, sin], [-sin, cos]])
        figure = plot_trajectory(replace(home(), floor_plan=turned, ground_truth=TRUTH * 0), TRUTH)
        figure.draw_without_rendering()
        axes, legend = figure.axes[0].get_window_extent(), figure.legends[0].get_window_extent()
        assert (legend.y1 < axes.y0) == below
        assert (legend.x0 > axes.x1) != below
        assert legend.x0 >= 0
        assert legend.x1 <= figure.bbox.x1


def test_a_legend_of_many_rows_leaves_room_for_the_title():
    dataset = replace(home(), floor_plan=WALLS * [1.25, 2.0])
    for number in (4, 12):
        positions = np.column_stack([np.linspace(0.5, 5.5, 2 * number), np.full(2 * number, 2.0)])
        places = np.arange(2 * number) // 2
        figure = plot_places(positions, places, [(0, 1)], [0.9], dataset, title="many places")
        figure.draw_without_rendering()
        assert len(figure.legends[0].get_texts()) == number + 1
        assert figure.axes[0].title.get_window_extent().y1 <= figure.bbox.y1


def test_trajectory_of_a_bare_dataset():
    bare = Dataset(
        name="bare",
        camera=EquirectangularPanorama(64, 32),
        stamps=np.arange(2.0),
        image_paths=(Path("a.png"), Path("b.png")),
    )
    figure = plot_trajectory(bare, np.zeros((2, 3)))
    assert labels(figure) == {"estimate"}


def test_errors_mark_convergence_and_keep_gaps():
    estimates = TRUTH.copy()
    estimates[:3, 0] += 2.0
    estimates[4] = np.nan
    truth = TRUTH.copy()
    truth[5] = np.nan
    errors = trajectory_errors(estimates, truth)
    found = trajectory_errors(np.where(np.arange(N)[:, None] < 3, estimates, TRUTH), TRUTH)
    figure = plot_errors({"lost": errors, "found": found}, x=np.arange(N) * 0.5, xlabel="t [s]")
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == (
        "position error [m]",
        "heading error [deg]",
    )
    assert lower.get_xlabel() == "t [s]"
    # the infinite error of "lost" spoils its convergence; that of "found" is at step 3
    assert labels(figure) == {"lost", "found", "converged at 1.5 (found)"}
    drawn = {line.get_label(): line.get_ydata() for line in upper.get_lines()}
    np.testing.assert_allclose(drawn["lost"], [2, 2, 2, 1e-4, np.nan, np.nan])
    single = plot_errors(errors[:4])
    assert labels(single) == {"converged at 3"}
    assert labels(plot_errors(errors)) == set()


def test_errors_of_pairs_are_drawn_at_the_bins_that_have_enough():
    distance = np.array([0.1, 0.2, 0.3, 0.4, 1.1, 1.2, 2.2, 2.4, 7.0])
    heading = np.radians(np.arange(9.0))
    errors = {
        "a": PairErrors(heading, heading, 2 * heading, 0.0),
        "b": PairErrors(*[heading] * 3, 0),
    }
    figure = plot_pair_errors(
        distance, errors, xlabel="distance [m]", edges=[0, 1, 2, 3], least=2, title="t"
    )
    for axes, title, factor in zip(figure.axes, ("heading", "rotation"), (1, 2), strict=True):
        assert axes.get_ylabel() == f"{title} error [deg], median and MAD"
        assert axes.get_xlabel() == "distance [m]"
        a, b = (container.lines[0] for container in axes.containers)
        assert a.get_xdata() == pytest.approx([0.5, 1.5, 2.5], abs=0.02)
        assert a.get_ydata() == pytest.approx(factor * np.array([1.5, 4.5, 6.5]))
        assert b.get_ydata() == pytest.approx([1.5, 4.5, 6.5])
    few = plot_pair_errors(distance, errors, xlabel="x", edges=[0, 1, 2, 3], least=3)
    assert len(few.axes[0].containers[0].lines[0].get_xdata()) == 1
    with pytest.raises(ValueError, match="at least one setting"):
        plot_pair_errors(distance, errors, xlabel="x", edges=[0, 1, 2, 3])


@pytest.mark.parametrize("x", [[0.0, 0.5, 0.9], ["home 1", "home 2", "car"]])
def test_medians_stand_in_panels_with_their_deviations(x):
    rng = np.random.default_rng(0)
    drawn = {name: [rng.exponential(size=41) for _ in x] for name in ("LUT", "RANSAC")}
    figure = plot_medians(
        x, {"heading error [deg]": drawn, "rotation error [deg]": drawn}, xlabel="mismatches"
    )
    assert len(figure.axes) == 2
    for axes, label in zip(figure.axes, ("heading", "rotation"), strict=True):
        assert axes.get_xlabel() == "mismatches"
        assert axes.get_ylabel() == f"{label} error [deg], median and MAD"
        assert axes.get_yscale() == "log"
        places = []
        for container, name in zip(axes.containers, drawn, strict=True):
            assert container.get_label() == name
            line, _, (bars,) = container.lines
            median = [np.median(values) for values in drawn[name]]
            assert line.get_ydata() == pytest.approx(median)
            for segment, values, middle in zip(
                bars.get_segments(), drawn[name], median, strict=True
            ):
                mad = np.median(np.abs(values - middle))
                assert segment[:, 1] == pytest.approx(
                    [middle - min(mad, 0.9 * middle), middle + mad]
                )
            places.append(line.get_xdata())
        # of one setting they stand beside each other
        assert (places[0] < places[1]).all()
        if isinstance(x[0], str):
            assert [tick.get_text() for tick in axes.get_xticklabels()] == x
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(drawn)


def test_medians_of_nothing_are_refused():
    for x, panels in (([], {"error [deg]": {}}), ([1.0], {})):
        with pytest.raises(ValueError, match="expected at least one setting and one panel"):
            plot_medians(x, panels, xlabel="x")


def test_posterior_axes_are_theta_and_phi():
    log_prob = np.full((36, 36), -20.0)
    log_prob[3, 30] = -1.0  # heading_l 30 to 40 deg, heading_r 300 to 310 deg
    log_prob[0, 0] = -np.inf
    truth = np.radians([35.0, -55.0])
    figure = plot_posterior(log_prob, mode=truth, truth=truth, title="t")
    axes = figure.axes[0]
    image = axes.get_images()[0]
    row, column = np.unravel_index(np.nanargmax(image.get_array()), (36, 36))
    assert (column, row) == (3, 30)
    assert image.get_extent() == [0, 360, 0, 360]
    for line in axes.get_lines():
        np.testing.assert_allclose(line.get_xydata(), [[35, 305]])
    assert "heading_l" in axes.get_xlabel()
    assert "[nat]" in figure.axes[1].get_ylabel()
    for bad in (np.zeros((3, 4)), np.full((4, 4), -np.inf)):
        with pytest.raises(ValueError, match="log_prob"):
            plot_posterior(bad)


@pytest.mark.parametrize(("width", "offset"), [(64, (0, 36)), (40, (44, 0))])
def test_correspondences_stack_panoramas_and_put_photographs_side_by_side(width, offset):
    images = np.zeros((2, 32, width), np.uint8)
    left, right = [[1, 2], [3, 4], [5, 6]], [[7, 8], [9, 10], [11, 12]]
    figure = plot_correspondences(*images, left, right, inliers=[True, False, True], title="t")
    axes = figure.axes[0]
    lines = {
        c.get_label(): c.get_segments() for c in axes.collections if hasattr(c, "get_segments")
    }
    assert set(lines) == {"mismatches: 1", "agree with the pose: 2"}
    np.testing.assert_array_equal(lines["mismatches: 1"][0], [[3, 4], np.add([9, 10], offset)])
    canvas = axes.get_images()[0].get_array()
    assert canvas[offset[1], offset[0]] == 0
    color = plot_correspondences(
        np.zeros((32, width, 3), np.uint8), images[1], left, right, quality=[0.1, 0.5, 0.8]
    )
    assert "ratio" in color.axes[1].get_ylabel()
    assert plot_correspondences(*images, [], []).axes
    for bad in ({"pixels_r": right[:2]}, {"pixels_r": right, "inliers": [True]}):
        with pytest.raises(ValueError, match="expected 3 values each"):
            plot_correspondences(*images, left, **bad)


def test_animation_is_a_gif_of_all_frames(tmp_path):
    from PIL import Image

    rng = np.random.default_rng(0)
    frames = [
        ParticleFrame(
            rng.uniform([0, 0, -3], [8, 4, 3], (100, 3)),
            log_weights=rng.normal(size=100) if i else None,
            estimate=TRUTH[i] if i else [np.nan] * 3,
            ground_truth=TRUTH[i],
            title=f"image {i}",
        )
        for i in range(4)
    ]
    done = []
    path = tmp_path / "a.gif"
    animate_particles(
        home(), frames, path, fps=5, size=3, dpi=40, progress=lambda *s: done.append(s)
    )
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    with Image.open(path) as gif:
        assert gif.n_frames == 4
        gif.seek(3)
        assert gif.info["duration"] == 2000
    assert list(tmp_path.iterdir()) == [path]


def test_animation_refuses_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="at least one"):
        animate_particles(home(), [], path)
    with pytest.raises(ValueError, match=r"ends in \.gif"):
        animate_particles(home(), [ParticleFrame(TRUTH)], tmp_path / "a.mp4")
    broken = [ParticleFrame(TRUTH), ParticleFrame(np.zeros((2, 2)))]
    with pytest.raises(ValueError, match="reshape"):
        animate_particles(home(), broken, path, size=2, dpi=20)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_same_figure_gives_the_same_bytes(tmp_path, suffix):
    for name in ("a", "b"):
        save_figure(plot_trajectory(home(), TRUTH, TRUTH), tmp_path / (name + suffix), dpi=50)
    first, second = ((tmp_path / (name + suffix)).read_bytes() for name in ("a", "b"))
    assert first == second
    assert len(list(tmp_path.iterdir())) == 2


def test_a_figure_of_no_known_format(tmp_path):
    figure = plot_posterior(np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"a\.xyz: no format for figures, expected one of"):
        save_figure(figure, tmp_path / "a.xyz")
    assert not list(tmp_path.iterdir())


def test_pose_graph_shows_the_links_that_are_believed():
    links = np.array([[0, 1], [1, 2], [0, 3], [2, 5]])
    probability = np.array([0.9, 0.2, 0.6, 0.99])
    odometry = TRUTH + np.array([0.0, 3.0, 0.0])  # beyond the walls
    figure = plot_pose_graph(
        home(), TRUTH, links, probability, odometry=odometry, ground_truth=TRUTH, title="a map"
    )
    axes, colors = figure.axes
    (drawn,) = [c for c in axes.collections if c.get_array() is not None]
    np.testing.assert_array_equal(drawn.get_array(), [0.6, 0.9, 0.99])
    np.testing.assert_array_equal(drawn.get_segments()[0], TRUTH[[0, 3], :2])
    assert axes.get_ylim()[1] > 5.0 and axes.get_title() == "a map"
    labels = {line.get_label() for line in axes.lines}
    assert labels == {"ground truth", "odometry", "pose graph"}
    assert colors.get_ylabel() == "probability of a link"
    assert plot_pose_graph(home(), TRUTH, np.empty((0, 2)), np.empty(0)).axes
