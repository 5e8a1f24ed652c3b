"""The figures of a replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pflut.geometry import FloatArray, relative_headings
from pflut.localization.resampling import systematic_indices
from pflut.plot.animation import ParticleFrame, animate_particles
from pflut.plot.errors import plot_errors
from pflut.plot.map import plot_trajectory
from pflut.plot.pair import plot_posterior
from pflut.plot.style import BLUE, GREY, VERMILION, new_figure, save_figure, tidy
from pflut.posterior import Likelihood, pose_posterior
from pflut.relpose.estimate import estimate_relative_pose
from pflut.replay.result import SUCCESS_HEADING, SUCCESS_POSITION, ReplayResult

#: After these steps the particles are worth drawing: they show how a lost robot converges.
SHOWN_STEPS = (0, 1, 3, 7)
_DRAWN = 1500  # particles; more only hide each other


def draw_figures(folder: Path, result: ReplayResult, likelihood: Likelihood) -> list[Path]:
    """Write the figures of a replay.

    Parameters
    ----------
    folder : Path
        Created if missing.
    result : ReplayResult
    likelihood : LikelihoodTable or DenseTable
        For the posterior of one pair.

    Returns
    -------
    list of Path
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"trajectory": trajectory_figure(result)}
    if result.errors is not None and result.each_on_its_own:
        figures["confidence"] = confidence_figure(result)
    elif result.errors is not None:
        methods = {"particle filter": result.errors}
        if result.odometry_errors is not None:
            methods["odometry alone"] = result.odometry_errors
        number = np.arange(1, len(result) + 1)
        figures["errors"] = plot_errors(methods, x=number, title=result.dataset.name)
    if result.pair is not None:
        figures["posterior"] = posterior_figure(result, likelihood)
    paths = []
    for name, figure in figures.items():
        paths.append(folder / f"{name}.png")
        save_figure(figure, paths[-1])
    return paths


def trajectory_figure(result: ReplayResult) -> Figure:
    """Draw the estimates over the map, with the truth, the odometry and some particles."""
    clouds = {
        f"image {number + 1}": _drawn(*result.snapshots[number])
        for number in SHOWN_STEPS
        if number in result.snapshots
    }
    alone = result.odometry_alone
    return plot_trajectory(
        result.dataset,
        result.estimates,
        result.ground_truth,
        particles=clouds,
        others=None if alone is None else {"odometry alone": alone},
        connected=not result.each_on_its_own,
        title=result.dataset.name,
    )


def confidence_figure(result: ReplayResult) -> Figure:
    """Draw the position errors of images localized on their own against their confidence."""
    assert result.errors is not None
    good = result.errors.within(SUCCESS_POSITION, SUCCESS_HEADING)
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    limit = f"{SUCCESS_POSITION:g} m and {np.degrees(SUCCESS_HEADING):g} deg"
    for chosen, color, name in ((good, BLUE, "within"), (~good, VERMILION, "not within")):
        label = f"{name} {limit}: {int(chosen.sum())}"
        axes.plot(
            result.confidence[chosen],
            result.errors.position[chosen],
            "o",
            color=color,
            markersize=5,
            label=label,
        )
    axes.axhline(SUCCESS_POSITION, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_yscale("log")
    axes.set(
        xlim=(-0.02, 1.02),
        xlabel="confidence",
        ylabel="position error [m]",
        title=result.dataset.name,
    )
    tidy(axes)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def posterior_figure(result: ReplayResult, likelihood: Likelihood) -> Figure:
    """Draw the posterior of the pair with the most matches."""
    assert result.pair is not None
    pair, dataset = result.pair, result.dataset
    posterior = pose_posterior(pair.correspondences, likelihood)
    estimate = estimate_relative_pose(pair.correspondences, likelihood)
    truth = None
    poses = dataset.ground_truth
    if poses is not None and np.isfinite(poses[[pair.reference, pair.query]]).all():
        theta, phi, distance = relative_headings(poses[pair.reference], poses[pair.query])
        truth = (float(theta), float(phi)) if distance > 0.0 else None
    names = [dataset.image_paths[i].name for i in (pair.reference, pair.query)]
    return plot_posterior(
        posterior.log_prob,
        mode=(estimate.heading_l, estimate.heading_r),
        truth=truth,
        title=f"{names[0]} and {names[1]}: {len(pair.correspondences)} matches",
    )


def animate(
    path: Path, result: ReplayResult, *, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write an animation of the particles that the result has kept.

    Raises
    ------
    ValueError
        If it has kept none.
    """
    frames = []
    for number, (poses, log_weights) in sorted(result.snapshots.items()):
        step = None if number < 0 else result.steps[number]
        where = "start" if step is None else f"image {number + 1} of {len(result)}"
        frames.append(
            ParticleFrame(
                _drawn(poses, log_weights),
                estimate=None if step is None else step.estimate.pose,
                ground_truth=None if step is None else step.ground_truth,
                title=f"{result.dataset.name}: {where}",
            )
        )
    animate_particles(result.dataset, frames, path, progress=progress)


def _drawn(poses: FloatArray, log_weights: FloatArray) -> FloatArray:
    """Choose some particles by their weights, always the same."""
    weights = np.exp(log_weights - log_weights.max())
    return poses[systematic_indices(weights, min(_DRAWN, len(poses)), 0.5)]
