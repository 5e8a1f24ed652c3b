"""The posterior of a turn on the spot: the rotation is known, the headings are not. Figure 8.

    python sims/turn_on_the_spot.py [--quick] [--seed SEED] [--output DIR]

Draws two pairs of views with the paper's table and with the default one: 40 simulated
correspondences seen from one place, three in ten of them mismatches; and two images of a rendered
home, taken 1 cm apart, of whose matches 25 are chosen, as many as the paper's pairs have.

Then many pairs of three kinds, each with 25 and with 100 correspondences: *turned*, simulated, seen
from one place; *images*, of the home, 1 cm apart; and *apart*, of the paper's simulator, for
comparison. How many of the 95 % regions of the rotation hold the true one, and of the 95 % regions
of the pose the true pose (turned: one of any heading); how far off the mean rotation is; and the
entropies of the rotation's and the heading's marginals, of 4.85 nat if nothing is known. Prints two
tables, writes a CSV and a figure.

To expect: with either table the posterior is a band along the true rotation, all around the circle;
the rotation is within a degree and in its region, and of the heading little is known. But along the
band the posterior is too sure, the default table's more than the paper's, and with more
correspondences more: with 100 the regions of 95 % hold one to four in ten of the true poses.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import (
    Correspondences,
    CorrespondenceSimulator,
    DenseTable,
    FeatureExtractor,
    GridPosterior,
    LikelihoodTable,
    pose_posterior,
)
from pflut._files import write_csv
from pflut.datasets.simulated_home import CAMERA, MAPPING_LIGHT
from pflut.features import match
from pflut.geometry import (
    TWO_PI,
    relative_headings,
    rotation_from_headings,
    wrap_to_2pi,
    wrap_to_pi,
)
from pflut.likelihood.known_pairs import Pair
from pflut.plot import save_figure
from pflut.plot.style import COLORMAP, VERMILION, new_figure
from pflut.simulation.drive import plan_mapping_drive
from pflut.simulation.home import Home
from pflut.simulation.lighting import make_light_map
from pflut.simulation.renderer import render_panorama

ROTATION = float(np.radians(66.0))
APART = 0.01
"""Metres between two images."""
MISMATCH = 0.3
COUNTS = (25, 100)
REGION = 0.95
SHOWN = 40.0
"""Nats below the maximum that colors reach."""
COLUMNS = ("table", "views", "correspondences", "pairs", "rotation_in_95", "pose_in_95")
COLUMNS += ("rotation_error_deg", "rotation_entropy_nat", "heading_entropy_nat")


def turned(rotation: float, count: int, rng: np.random.Generator) -> Pair:
    """Simulate landmarks in all directions, seen twice from one place; any heading is right."""
    noise = CorrespondenceSimulator().noise
    azimuth, wrong_azimuth = rng.uniform(0.0, TWO_PI, (2, count))
    elevation, wrong_elevation = np.arcsin(rng.uniform(-0.8, 0.8, (2, count)))
    azimuth_r = azimuth - rotation + noise * rng.normal(size=count) / np.cos(elevation)
    elevation_r = elevation + noise * rng.normal(size=count)
    wrong = np.arange(count) < round(MISMATCH * count)
    azimuth_r[wrong], elevation_r[wrong] = wrong_azimuth[wrong], wrong_elevation[wrong]
    heading = float(rng.uniform(0.0, TWO_PI))
    correspondences = Correspondences(azimuth, elevation, azimuth_r, elevation_r)
    return correspondences, heading, heading - rotation + np.pi


def apart(count: int, rng: np.random.Generator) -> Pair:
    """Simulate a pair as the paper does."""
    return CorrespondenceSimulator(mismatch=MISMATCH).pair(count, rng)


def images(places: int, seed: int) -> Iterator[Pair]:
    """Match images of a home, taken at the places of the mapping drive; matches in random order."""
    rng = np.random.default_rng(seed)
    home = Home.generate(seed)
    light_map = make_light_map(home, MAPPING_LIGHT)
    extractor = FeatureExtractor(CAMERA)
    poses = plan_mapping_drive(home, rng=rng).poses
    for k, pose in enumerate(poses[np.linspace(0, len(poses) - 1, places).astype(int)]):
        direction = rng.uniform(0.0, TWO_PI)
        # the first one is drawn, and all are alike
        rotation = ROTATION if k == 0 else rng.uniform(-np.pi, np.pi)
        beside = pose + np.array(
            [*APART * np.array([np.cos(direction), np.sin(direction)]), rotation]
        )
        reference, query = (
            extractor(
                # red, green and blue; the extractor takes them the other way round
                render_panorama(home, view, CAMERA, MAPPING_LIGHT, light_map=light_map, rng=rng)[
                    ..., ::-1
                ]
            )
            for view in (pose, beside)
        )
        found = match(reference, query)
        order = rng.permutation(len(found))
        heading_l, heading_r, _ = relative_headings(pose, beside)
        yield some(found, order), float(heading_l), float(heading_r)


def some(c: Correspondences, chosen: np.ndarray) -> Correspondences:
    """Choose some of the correspondences, without their quality."""
    columns = (c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r)
    return Correspondences(*(column[chosen] for column in columns))


def entropy(probabilities: np.ndarray) -> float:
    """Give the entropy of a marginal, nats."""
    possible = probabilities[probabilities > 0.0]
    return float(-np.sum(possible * np.log(possible)))


def rotation_held(posterior: GridPosterior, rotation: float) -> bool:
    """Say whether the smallest region of rotations with the mass holds one."""
    angles, probabilities = posterior.rotation()
    order = np.argsort(-probabilities)
    region = order[: int(np.searchsorted(np.cumsum(probabilities[order]), REGION)) + 1]
    # the poses of a diagonal of cells have rotations up to a cell to either side
    return bool((np.abs(wrap_to_pi(angles[region] - rotation)) < TWO_PI / posterior.bins).any())


def measure(
    posterior: GridPosterior, heading_l: float, heading_r: float
) -> tuple[bool, bool, float, float, float]:
    """Give whether rotation and pose are held, the rotation's error [deg] and the entropies."""
    rotation = float(rotation_from_headings(heading_l, heading_r))
    return (
        rotation_held(posterior, rotation),
        posterior.credible_mass(heading_l, heading_r) <= REGION,
        abs(float(np.degrees(wrap_to_pi(posterior.rotation_mean() - rotation)))),
        entropy(posterior.rotation()[1]),
        entropy(posterior.heading_l()),
    )


def draw(shown: list[tuple[str, GridPosterior]]) -> Figure:
    """Draw posteriors of the same rotation, and the poses of the true one as a line."""
    theta = np.linspace(0.0, TWO_PI, 721)
    phi = wrap_to_2pi(theta - ROTATION + np.pi)
    phi[np.abs(np.diff(phi, append=phi[-1])) > np.pi] = np.nan
    figure = new_figure(9.4, 8.4)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (title, posterior) in zip(panels.flat, shown, strict=True):
        image = axes.imshow(
            (posterior.log_prob - posterior.log_prob.max()).T,
            origin="lower",
            extent=(0.0, 360.0, 0.0, 360.0),
            cmap=COLORMAP,
            vmin=-SHOWN,
            vmax=0.0,
            interpolation="nearest",
        )
        axes.plot(
            np.degrees(theta),
            np.degrees(phi),
            color=VERMILION,
            linewidth=1.2,
            linestyle=(0, (4, 8)),
            label="true rotation",
        )
        axes.set_title(title, fontsize=10)
    ticks = np.arange(0, 361, 90)
    panels[0, 0].set(xlim=(0, 360), ylim=(0, 360), xticks=ticks, yticks=ticks)
    for axes in panels[1]:
        axes.set_xlabel("heading_l θ [deg]")
    for axes in panels[:, 0]:
        axes.set_ylabel("heading_r φ [deg]")
    label = "log-probability below the maximum [nat]"
    figure.colorbar(image, ax=panels, label=label, shrink=0.6, extend="min")
    panels[0, 0].legend(loc="upper left", facecolor="0.25", labelcolor="white", fontsize=9)
    return figure


def main() -> None:
    """Look at two turns, then at many."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the pairs, 20 of images")
    parser.add_argument("--seed", type=int, default=0, help="of the pairs and of the home")
    parser.add_argument("--output", type=Path, default=Path("results/turn_on_the_spot"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    turns, places = (100, 20) if arguments.quick else (1_000, 80)
    tables = {"the paper's": DenseTable.default(), "default": LikelihoodTable.default()}
    met = images(places, arguments.seed)
    imaged = list(tqdm(met, desc="images", unit="pair", total=places, disable=None))
    first = {
        "40 simulated matches": turned(ROTATION, 40, np.random.default_rng(arguments.seed)),
        "25 matches of two images": (some(imaged[0][0], np.arange(25)), *imaged[0][1:]),
        f"all {len(imaged[0][0])} of them": imaged[0],
    }
    print(f"a rotation by {np.degrees(ROTATION):g} deg; nothing known: {np.log(128):.2f} nat")
    print(
        f"{'correspondences':26}{'table':13}{'entropy of rotation':>20}{'heading':>9}"
        f"{'mean_deg':>10}{'in 95 %':>9}"
    )
    shown = []
    for views, (correspondences, *truth) in first.items():
        for name, table in tables.items():
            posterior = pose_posterior(correspondences, table)
            held, _, _, rotation, heading = measure(posterior, *truth)
            mean, answer = np.degrees(posterior.rotation_mean()), "yes" if held else "no"
            print(f"{views:26}{name:13}{rotation:20.2f}{heading:9.2f}{mean:10.2f}{answer:>9}")
            shown.append((f"{views}, {name} table", posterior))
    save_figure(draw(shown[:4]), arguments.output / "turn_on_the_spot.png")

    rng = np.random.default_rng([arguments.seed, 1])
    kinds = {}
    for count in COUNTS:
        rotations = rng.uniform(-np.pi, np.pi, turns)
        kinds["turned", count] = [turned(rotation, count, rng) for rotation in rotations]
        kinds["images", count] = [(some(c, np.arange(min(count, len(c)))), *t) for c, *t in imaged]
        kinds["apart", count] = [apart(count, rng) for _ in range(turns)]
    rows = []
    print(f"\n{turns} simulated pairs, {places} of images; shares of pairs, and means")
    print(
        f"{'table':13}{'views':8}{'count':>6}{'rotation in 95 %':>18}{'pose in 95 %':>14}"
        f"{'rotation error_deg':>20}{'entropy of rotation':>21}{'heading':>9}"
    )
    with tqdm(total=2 * sum(map(len, kinds.values())), unit="pair", disable=None) as bar:
        for name, table in tables.items():
            for (views, count), pairs in kinds.items():
                values = []
                for correspondences, *truth in pairs:
                    values.append(measure(pose_posterior(correspondences, table), *truth))
                    bar.update()
                means = np.mean(values, axis=0).tolist()
                rows.append((name, views, count, len(pairs), *means))
                held, pose, error, rotation, heading = means
                tqdm.write(
                    f"{name:13}{views:8}{count:6}{held:18.3f}{pose:14.3f}{error:20.2f}"
                    f"{rotation:21.2f}{heading:9.2f}"
                )
    write_csv(arguments.output / "turn_on_the_spot.csv", COLUMNS, rows)
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
