"""What a correspondence says of the pose, by its ratio r: slices of the tables, Figure 4.

    python sims/table_slices.py [--quick] [--output DIR]

Over u = theta - alpha_l and v = phi - alpha_r, in rows: the paper's table with its mismatches
simulated, as in the paper; the same with uniform mismatches, pflut's default of it; and what the
residual table knows of a correspondence of the same r whose point stands 17 degrees high in the
reference, and 3 degrees, near the horizon. The paper's table takes these two for the same.

To expect: with the paper's mismatches r near 0 tells least and r near 1 most, since mismatches
seldom have such an r, and their cloud, which tells that landmarks lie between the cameras, covers
the curve where r is small or negative. Of the curves that of r = 1 alone is about symmetric. The
residual table's are sharp high above the horizon and broad near it.

Prints for each slice what it tells of the pose in nats (0: nothing), the share of the poses that it
speaks for, its highest likelihood ratio and its asymmetry under exchange of u and v (0: none, 1:
nothing in common); then what one true match of the simulator tells of its true pose. Writes a CSV
and a figure.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pflut import (
    Correspondences,
    CorrespondenceSimulator,
    DenseTable,
    LikelihoodTable,
    pose_posterior,
)
from pflut._files import write_csv
from pflut.plot import save_figure
from pflut.plot.style import COLORMAP, new_figure

RATIOS = (-0.5, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
ELEVATIONS_DEG = (17.0, 3.0)
NOTHING = -2.0 * np.log(2.0 * np.pi)
"""Log-density of a pose of which nothing is known."""
ALIKE = 1e-6
"""Ratios that differ by less differ by rounding."""
COLUMNS = ("table", "r", "information_nat", "speaks_for", "peak", "asymmetry")


@dataclass(frozen=True)
class Slice:
    """Likelihood ratios (B, B) of one correspondence over u and v, against the mean of them."""

    table: str
    r: float
    ratio: np.ndarray
    first: float
    """Where the first cell is centred, in cells."""

    def row(self) -> tuple[str, float, float, float, float, float]:
        """Give the row of the CSV."""
        # all poses are as probable beforehand: the mean of p log p is the information
        information = float(np.mean(self.ratio * np.log(self.ratio)))
        above = np.where(self.ratio > 1.0 + ALIKE, self.ratio - 1.0, 0.0)
        both = float((above + above.T).sum())
        asymmetry = float(np.abs(above - above.T).sum()) / both if both else 0.0
        speaks_for = float(np.mean(above > 0.0))
        return self.table, self.r, information, speaks_for, float(self.ratio.max()), asymmetry


def made_slice(table: str, r: float, log_ratio: np.ndarray, first: float) -> Slice:
    """Scale likelihood ratios to a mean of one."""
    ratio = np.exp(log_ratio.astype(np.float64))
    return Slice(table, r, ratio / ratio.mean(), first)


def dense_slices(name: str, table: DenseTable) -> list[Slice]:
    """Cut the paper's table at the cells that hold the ratios."""
    cells = len(table.log_ratio)
    chosen = [min(int(0.5 * (r + 1.0) * cells), cells - 1) for r in RATIOS]
    # u and v are differences of two cells' numbers, so the first cell is centred on zero
    return [
        made_slice(name, 2.0 * (k + 0.5) / cells - 1.0, table.log_ratio[k], 0.0) for k in chosen
    ]


def residual_slices(
    table: LikelihoodTable, elevation_deg: float, ratios: Iterable[float]
) -> list[Slice]:
    """Evaluate correspondences straight ahead, whose elevations have the ratios."""
    elevation = np.radians(elevation_deg)
    slices = []
    for r in ratios:
        one = Correspondences([0.0], [elevation], [0.0], [np.arctan(r * np.tan(elevation))])
        grid = table.log_likelihood_grid(one)
        slices.append(made_slice(f"residual, {elevation_deg:g}°", r, grid, 0.5))
    return slices


def told(table: DenseTable | LikelihoodTable, count: int) -> float:
    """Give what one true match tells of its true pose, nats in the mean over many."""
    simulator = CorrespondenceSimulator(mismatch=0.0)
    headings, bearings = simulator.sample(count, 1, rng=1)
    gained = [
        pose_posterior(Correspondences(*pair.T), table).log_density(*truth) - NOTHING
        for truth, pair in zip(headings, bearings, strict=True)
    ]
    return float(np.mean(gained))


def draw(rows: Sequence[Sequence[Slice]]) -> Figure:
    """Draw a row of slices for each table, all in the same colors."""
    figure = new_figure(12.6, 1.45 * len(rows) + 0.5)
    panels = figure.subplots(len(rows), len(RATIOS), sharex=True, sharey=True)
    for line, slices in zip(panels, rows, strict=True):
        for axes, one in zip(line, slices, strict=True):
            half, cell = len(one.ratio) // 2, 360.0 / len(one.ratio)
            low = -180.0 + (one.first - 0.5) * cell
            image = axes.imshow(
                np.log(np.roll(one.ratio, (half, half), axis=(0, 1))).T,
                origin="lower",
                extent=(low, low + 360.0, low, low + 360.0),
                cmap=COLORMAP,
                vmin=-0.5,
                vmax=3.5,
            )
        line[0].set_ylabel(slices[0].table.replace(", ", ",\n") + "\nv [deg]", fontsize=9)
    for axes, one in zip(panels[0], rows[0], strict=True):
        axes.set_title(f"r = {one.r:.2f}", fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel("u [deg]", fontsize=9)
    ticks = (-180, 0, 180)
    panels[0, 0].set(xlim=(-180, 180), ylim=(-180, 180), xticks=ticks, yticks=ticks)
    figure.colorbar(
        image,
        ax=panels,
        label="log of the likelihood ratio against all poses [nat]",
        shrink=0.6,
        extend="both",
    )
    return figure


def main() -> None:
    """Cut, measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer samples and true matches")
    parser.add_argument("--output", type=Path, default=Path("results/table_slices"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    samples, matches = (16_000_000, 500) if arguments.quick else (128_000_000, 10_000)
    with tqdm(desc="learning", total=2 * samples, unit_scale=True, disable=None) as bar:
        dense = {
            name: DenseTable.from_simulation(
                num_samples=samples,
                mismatches=mismatches,
                progress=lambda done, _, start=i * samples: bar.update(start + done - bar.n),
            )
            for i, (name, mismatches) in enumerate(
                (("the paper's", "simulated"), ("paper's, uniform", "uniform"))
            )
        }
    rows = [dense_slices(name, table) for name, table in dense.items()]
    ratios = [one.r for one in rows[0]]
    table = LikelihoodTable.default()
    # many cells, to see the curve's own width
    fine = table.with_bins(256)
    rows += [residual_slices(fine, elevation, ratios) for elevation in ELEVATIONS_DEG]
    print(f"{'table':18}{'r':>6}{'tells [nat]':>13}{'speaks for':>12}{'peak':>7}{'asymmetry':>11}")
    measured = [one.row() for slices in rows for one in slices]
    for name, r, information, share, peak, asymmetry in measured:
        print(f"{name:18}{r:6.2f}{information:13.3f}{share:12.1%}{peak:7.1f}{asymmetry:11.2f}")
    print(f"a true match tells of its true pose, mean of {matches}, 128 bins [nat]: ", end="")
    gains = ((name, told(one, matches)) for name, one in {**dense, "residual": table}.items())
    print(", ".join(f"{name} {gain:.2f}" for name, gain in gains))
    write_csv(arguments.output / "table_slices.csv", COLUMNS, measured)
    save_figure(draw(rows), arguments.output / "table_slices.png")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
