"""Make the pictures of the documentation, all from the project's own simulator.

    python sims/doc_images.py [conventions|replay|home|relpose|maps|places|nodes ...]

Without names all of them, in some minutes. They go to docs/images/.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Rectangle
from PIL import Image

from pflut.cli import main as pflut_command
from pflut.datasets import load_dataset
from pflut.geometry import relative_headings
from pflut.plot.style import BLACK, BLUE, GREY, VERMILION

IMAGES = Path(__file__).parents[1] / "docs" / "images"
MAX_BYTES = 400_000
GREEN = "#009E73"


def replay() -> None:
    """Replay the simulated home: the particles converging, the trajectory, a posterior."""
    with tempfile.TemporaryDirectory() as folder:
        run(["replay", "--animate", "--max-images", "24", "--output", f"{folder}/short"])
        shutil.copy(f"{folder}/short/figures/particles.gif", IMAGES)
        run(["replay", "--output", f"{folder}/all"])
        for name in ("trajectory", "errors", "posterior"):
            shrink(Path(folder) / "all" / "figures" / f"{name}.png", IMAGES / f"{name}.png")


def home() -> None:
    """Show one place of the simulated home in both drives: a reference and the nearest query."""
    dataset = load_dataset("simulated-home")
    truth = dataset.ground_truth
    assert truth is not None
    references, queries = dataset.reference_indices, dataset.query_indices
    offsets = truth[references, None, :2] - truth[None, queries, :2]
    i, j = np.unravel_index(
        np.argmin(np.hypot(offsets[..., 0], offsets[..., 1])), offsets.shape[:2]
    )
    pair = [Image.open(dataset.image_paths[k]) for k in (references[i], queries[j])]
    width, height = pair[0].size
    both = Image.new("RGB", (width, 2 * height + 6), "white")
    for row, picture in enumerate(pair):
        both.paste(picture, (0, row * (height + 6)))
    both.save(IMAGES / "home.jpg", quality=88)


def relpose() -> None:
    """Match a query of the simulated home with a reference 0.7 m away, and draw the matches."""
    dataset = load_dataset("simulated-home")
    query = int(dataset.query_indices[20])
    truth = dataset.ground_truth
    assert truth is not None
    *_, distance = relative_headings(truth[dataset.reference_indices], truth[query])
    reference = dataset.reference_indices[np.argmin(np.abs(distance - 0.7))]
    names = [dataset.image_paths[k].name for k in (reference, query)]
    with tempfile.TemporaryDirectory() as folder:
        figure = f"{folder}/pair.png"
        run(["relpose", *names, "--dataset", "simulated-home", "--figure", figure])
        shrink(Path(figure), IMAGES / "pair.jpg")


def maps() -> None:
    """Draw the map of the simulated home's mapping drive."""
    with tempfile.TemporaryDirectory() as folder:
        drive = ["--images", "references", "--simulate-odometry"]
        run(["map", "build", "simulated-home", *drive, "--output", f"{folder}/map"])
        shrink(Path(folder) / "map" / "figures" / "map.png", IMAGES / "map.jpg")


def places() -> None:
    """Draw the places of the simulated home, of both drives together."""
    with tempfile.TemporaryDirectory() as folder:
        run(["map", "places", "simulated-home", "--output", f"{folder}/places"])
        shrink(Path(folder) / "places" / "figures" / "places.png", IMAGES / "places.jpg")


def nodes() -> None:
    """Localize the simulated home's test drive in the topological map of its mapping drive."""
    with tempfile.TemporaryDirectory() as folder:
        drive = ["--images", "references", "--no-figures"]
        run(["map", "places", "simulated-home", *drive, "--output", f"{folder}/places"])
        run(["map", "localize", f"{folder}/places", "--output", f"{folder}/nodes"])
        shrink(Path(folder) / "nodes" / "figures" / "nodes.png", IMAGES / "nodes.png")


def conventions() -> None:
    """Draw the page of conventions: two views from above, one from the side, an image."""
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    axes = figure.subplot_mosaic(
        [["top", "side"], ["top", "image"]], width_ratios=[1.25, 1.0], height_ratios=[0.9, 1.0]
    )
    draw_top_view(axes["top"])
    draw_side_view(axes["side"])
    draw_image(axes["image"])
    figure.savefig(IMAGES / "conventions.png", dpi=110)


def draw_top_view(axes: Axes) -> None:
    """Draw two views from above, with theta, phi, psi and the azimuths of a landmark."""
    left, right = np.array([0.0, 0.0, -0.3]), np.array([3.6, 1.0, 1.2])
    landmark = (1.5, 3.3)
    theta, phi, _ = (float(value) for value in relative_headings(left, right))
    axes.plot([left[0], right[0]], [left[1], right[1]], color=GREY, linestyle="--", zorder=1)
    axes.plot(*landmark, marker="*", markersize=17, color=GREEN, zorder=4)
    axes.annotate("landmark", landmark, (6, 8), textcoords="offset points", color=GREEN)
    for name, pose, color in (("L", left, BLUE), ("R", right, VERMILION)):
        axes.plot([pose[0], landmark[0]], [pose[1], landmark[1]], color=GREEN, linewidth=0.9)
        draw_frame(axes, pose, color)
        axes.annotate(
            f"{name} ({'reference' if name == 'L' else 'query'})", pose[:2], (0, -24),
            textcoords="offset points", color=color, fontweight="bold", ha="center",
        )  # fmt: skip
    towards = [
        float((np.arctan2(landmark[1] - pose[1], landmark[0] - pose[0]) - pose[2]) % (2 * np.pi))
        for pose in (left, right)
    ]
    draw_angle(axes, left, theta, 0.75, BLUE, r"$\theta$ = heading_l", 0.4)
    draw_angle(axes, right, phi, 0.75, VERMILION, r"$\varphi$ = heading_r", 0.9)
    draw_angle(axes, left, towards[0], 1.85, GREEN, r"$\alpha_l$ = azimuth_l", 0.75)
    draw_angle(axes, right, towards[1], 1.3, GREEN, r"$\alpha_r$ = azimuth_r", 0.35)
    psi = np.degrees(right[2] - left[2])
    axes.set_title("From above: all angles are counter-clockwise", fontsize=11)
    axes.text(
        0.02, 0.02,
        r"rotation  $\psi = \theta - \varphi + \pi$ = heading of R - heading of L"
        f"\nhere  {np.degrees(theta):.0f}"
        rf"$\degree$ - {np.degrees(phi):.0f}$\degree$ + 180$\degree$ = {psi:.0f}$\degree$",
        transform=axes.transAxes, fontsize=11,
    )  # fmt: skip
    axes.set(xlim=(-0.9, 4.9), ylim=(-1.5, 3.7), aspect="equal")
    axes.axis("off")


def draw_frame(axes: Axes, pose: np.ndarray, color: str) -> None:
    """Draw a robot with its x and y axes."""
    x, y, heading = pose
    axes.plot(x, y, "o", markersize=9, color=color, zorder=5)
    for angle, name, length in (
        (heading, "x", 2.0 if color == BLUE else 1.6),
        (heading + np.pi / 2, "y", 0.6),
    ):
        tip = (x + length * np.cos(angle), y + length * np.sin(angle))
        axes.annotate(
            "", tip, (x, y), arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.8}
        )
        axes.annotate(name, tip, (3, 3), textcoords="offset points", color=color, fontsize=11)


def draw_angle(
    axes: Axes, pose: np.ndarray, angle: float, radius: float, color: str, text: str, where: float
) -> None:
    """Draw an angle from a robot's x axis, an arrow head at its end, named somewhere along it."""
    start, end = pose[2], pose[2] + angle
    low, high = np.degrees(sorted((start, end)))
    axes.add_patch(
        Arc(pose[:2], 2 * radius, 2 * radius, theta1=low, theta2=high, color=color, linewidth=1.3)
    )
    tip = pose[:2] + radius * np.array([np.cos(end), np.sin(end)])
    before = end - np.sign(angle) * 0.05
    tail = pose[:2] + radius * np.array([np.cos(before), np.sin(before)])
    axes.annotate("", tip, tail, arrowprops={"arrowstyle": "-|>", "color": color})
    middle = pose[2] + where * angle
    at = pose[:2] + (radius + 0.08) * np.array([np.cos(middle), np.sin(middle)])
    side = "left" if np.cos(middle) >= 0 else "right"
    axes.text(*at, text, color=color, ha=side, va="center", fontsize=10)


def draw_side_view(axes: Axes) -> None:
    """Draw the elevations of a landmark from both views, and a pitched camera."""
    landmark, left, right = np.array([0.0, 1.5]), np.array([-1.6, 0.0]), np.array([3.2, 0.0])
    axes.axhline(0.0, color=GREY, linestyle=":", linewidth=1)
    axes.plot(*landmark, marker="*", markersize=15, color=GREEN)
    axes.plot([0, 0], [0, 1.5], color=GREEN, linestyle=":", linewidth=1)
    axes.text(0.08, 0.55, "h", color=GREEN)
    for name, place, color in (("l", left, BLUE), ("r", right, VERMILION)):
        axes.plot(*np.stack([place, landmark]).T, color=GREEN, linewidth=0.9)
        axes.plot(*place, "o", markersize=9, color=color)
        slope = np.degrees(np.arctan2(landmark[1], abs(place[0])))
        start = 0.0 if name == "l" else 180.0 - slope
        axes.add_patch(
            Arc(place, 1.4, 1.4, theta1=start, theta2=start + slope, color=color, linewidth=1.3)
        )
        axes.text(
            place[0] + (0.8 if name == "l" else -0.8), 0.16, rf"$\beta_{name}$", color=color,
            ha="left" if name == "l" else "right", fontsize=11,
        )  # fmt: skip
        axes.annotate(
            "", (0, -0.32), (place[0], -0.32), arrowprops={"arrowstyle": "<->", "color": color}
        )
        axes.text(0.5 * place[0], -0.66, rf"$d_{name}$", color=color, ha="center")
    axes.text(
        0.5, 0.02,
        r"$r = d_l / d_r = \tan\beta_r / \tan\beta_l$     $\beta$ = elevation, positive upwards",
        transform=axes.transAxes, ha="center", fontsize=10,
    )  # fmt: skip
    axes.set_title("From the side", fontsize=11)
    axes.set(xlim=(-2.2, 3.8), ylim=(-1.2, 1.9))
    axes.axis("off")


def draw_image(axes: Axes) -> None:
    """Draw a full panorama's pixels and bearings."""
    width, height = 8, 3
    for u in range(width):
        for v in range(height):
            axes.add_patch(
                Rectangle((u - 0.5, v - 0.5), 1, 1, facecolor="none", edgecolor="#cccccc")
            )
    axes.add_patch(
        Rectangle((-0.5, -0.5), width, height, facecolor="none", edgecolor=BLACK, linewidth=1.5)
    )
    axes.plot(0, 0, "o", color=BLACK, markersize=5)
    axes.text(0.15, 0.02, "(0, 0)", va="center", fontsize=9)
    axes.plot(width - 1, height - 1, "o", color=BLACK, markersize=5)
    axes.text(
        width - 1.15,
        height - 1,
        f"({width - 1}, {height - 1})",
        va="center",
        ha="right",
        fontsize=9,
    )
    middle = (width - 1) / 2
    axes.plot([middle, middle], [-0.5, height - 0.5], color=BLUE, linestyle="--", linewidth=1)
    for u, text in (
        (-0.5, r"$\alpha = \pi$" + "\nbehind"),
        (width / 4 - 0.5, r"$\alpha = \pi/2$" + "\nleft"),
        (middle, r"$\alpha = 0$" + "\nforward"),
        (3 * width / 4 - 0.5, r"$\alpha = 3\pi/2$" + "\nright"),
        (width - 0.5, r"$\alpha = \pi$" + "\nbehind"),
    ):
        axes.text(u, height - 0.35, text, ha="center", va="top", color=BLUE, fontsize=9)
    arrow = {"arrowstyle": "-|>", "color": BLACK}
    axes.annotate("u", (0.8, -0.85), (-0.5, -0.85), arrowprops=arrow, va="center")
    axes.annotate("v", (-0.85, 0.8), (-0.85, -0.5), arrowprops=arrow, ha="center")
    axes.text(width - 0.3, -0.5, r"$\beta$ max", va="center", color=VERMILION)
    axes.text(width - 0.3, height - 0.5, r"$\beta$ min", va="center", color=VERMILION)
    axes.set_title("A panorama: integers are pixel centers", fontsize=11)
    axes.set(xlim=(-1.4, width + 0.9), ylim=(height + 0.75, -1.5), aspect="equal")
    axes.axis("off")


def run(arguments: list[str]) -> None:
    """Run the command line."""
    print("pflut", *arguments)
    if pflut_command(arguments) != 0:
        raise SystemExit(1)


def shrink(source: Path, target: Path) -> None:
    """Copy a picture, at most 1000 pixels wide and high."""
    picture = Image.open(source).convert("RGB")
    picture.thumbnail((1000, 1000), Image.Resampling.LANCZOS)
    picture.save(target, optimize=True, quality=88)


PICTURES = {f.__name__: f for f in (conventions, replay, home, relpose, maps, places, nodes)}


def main() -> None:
    """Make those named, or all."""
    IMAGES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()
    for path in sorted(IMAGES.iterdir()):
        size = path.stat().st_size
        print(f"{path.name:<24}{size // 1000:>6} kB")
        if size > MAX_BYTES:
            raise SystemExit(f"{path}: larger than {MAX_BYTES // 1000} kB")


if __name__ == "__main__":
    main()
