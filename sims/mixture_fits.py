"""How well mixtures of von Mises distributions reproduce posteriors, and what they are called.

    python sims/mixture_fits.py [--quick] [--seed SEED] [--bins BINS] [--output DIR]

Pairs of the paper's simulator, with 10 to 100 correspondences and 0 to 95 % mismatches, and turns
on the spot, at the temperatures 1 and 0.3. For each group: how many pairs constrain anything; the
share of mixtures with a Kullback-Leibler divergence below 0.05 nats, of all pairs, of those that
constrain something, and with 16 components at most instead of 160; the median divergence; how many
components there are; and the time of the fit alone on one core, with either limit. Then the same by
kind, and what the mixtures lose of the true poses' log-density; and the time of
`extract_constraint`, which fits no more than 8 components to a posterior that constrains nothing.
Prints a table, writes a CSV and a figure.

To expect: of all pairs more than nine in ten are below 0.05 nats, most with one component in a
quarter of a millisecond. Posteriors of few matches and many mismatches are webs of ridges; they
take a hundred components and some milliseconds, and constrain nothing.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import thread_time

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm
from turn_on_the_spot import turned

from pflut import (
    CorrespondenceSimulator,
    GridPosterior,
    LikelihoodTable,
    PoseConstraint,
    extract_constraint,
    pose_posterior,
)
from pflut._files import write_csv
from pflut.likelihood.known_pairs import Pair
from pflut.mapping.constraint import KINDS
from pflut.plot import save_figure
from pflut.plot.style import COLORMAP, VERMILION, new_figure
from pflut.von_mises.fit import fit_mixture
from pflut.von_mises.mixture import MAX_COMPONENTS, VonMisesMixture

COUNTS = (10, 25, 50, 100)
MISMATCHES = (0.0, 0.5, 0.8, 0.9, 0.95)
TEMPERATURES = (1.0, 0.3)
TURNED = (25, 100)
TARGET = 0.05
"""Nats."""
FEW = 16
"""The other limit of components."""
SHOWN = 10.0
"""Nats below the maximum that colors reach."""
COLUMNS = ("pairs", "temperature", "correspondences", "mismatch", "kind", "divergence_nat")
COLUMNS += ("components", "fit_ms", "divergence_16_nat", "fit_16_ms", "loss_nat", "extract_ms")


@dataclass(frozen=True)
class Fit:
    """A pair's constraint, the times of its fits, and what the mixture loses at the true pose."""

    constraint: PoseConstraint
    divergence: float
    time: float
    divergence_few: float
    time_few: float
    loss: float
    time_extract: float

    def row(self) -> tuple[object, ...]:
        """Give the last columns of the CSV."""
        c = self.constraint
        few = (self.divergence_few, self.time_few)
        fit = (c.kind, self.divergence, c.mixture.num_components, self.time)
        return (*fit, *few, self.loss, self.time_extract)


def timed(posterior: GridPosterior, limit: int) -> tuple[VonMisesMixture, float]:
    """Fit, and give the mixture and the milliseconds of one core."""
    start = thread_time()
    mixture, _ = fit_mixture(posterior.log_prob, posterior.prob, max_components=limit)
    return mixture, 1e3 * (thread_time() - start)


def measure(posterior: GridPosterior, heading_l: float, heading_r: float) -> Fit:
    """Fit a pair's posterior, with both limits and as a constraint."""
    start = thread_time()
    constraint = extract_constraint(posterior)
    extracted = 1e3 * (thread_time() - start)
    few, time_few = timed(posterior, FEW)
    # of one that constrains nothing the constraint's is not fitted in full
    mixture, time = timed(posterior, MAX_COMPONENTS)
    divergence, divergence_few = (m.divergence(posterior.prob) for m in (mixture, few))
    grid = posterior.log_density(heading_l, heading_r)
    loss = grid - float(mixture.log_density([heading_l, heading_r]))
    return Fit(constraint, divergence, time, divergence_few, time_few, loss, extracted)


def groups(pairs: int, seed: int) -> Iterator[tuple[str, int, float, list[Pair]]]:
    """Simulate the pairs of all groups."""
    rng = np.random.default_rng(seed)
    for count in COUNTS:
        for share in MISMATCHES:
            simulator = replace(CorrespondenceSimulator(), mismatch=share)
            made, headings = simulator.pairs(pairs, count, rng=rng)
            listed = [(c, float(h[0]), float(h[1])) for c, h in zip(made, headings, strict=True)]
            yield "apart", count, share, listed
    for count in TURNED:
        rotations = rng.uniform(-np.pi, np.pi, pairs)
        yield "turned", count, 0.3, [turned(rotation, count, rng) for rotation in rotations]


def summary(fits: list[Fit]) -> str:
    """Give the columns of a printed row."""
    divergence = np.array([fit.divergence for fit in fits])
    useful = np.array([fit.constraint.kind != "none" for fit in fits])
    few = np.array([fit.divergence_few for fit in fits])
    components = np.mean([fit.constraint.mixture.num_components for fit in fits])
    times = np.array([[fit.time, fit.time_few] for fit in fits])
    below = f"{(divergence[useful] < TARGET).mean():.3f}" if useful.any() else "-"
    return (
        f"{len(fits):6}{useful.mean():12.3f}{(divergence < TARGET).mean():9.3f}{below:>10}"
        f"{(few < TARGET).mean():10.3f}{np.median(divergence):9.3f}{components:7.1f}"
        f"{times[:, 0].mean():9.2f}{np.median(times[:, 0]):9.2f}{times[:, 1].mean():9.2f}"
    )


def limits(name: str, fits: list[Fit]) -> Iterator[str]:
    """Give a printed row for either limit of components."""
    few = [(fit.divergence_few, fit.time_few) for fit in fits]
    for limit, pairs in (
        (MAX_COMPONENTS, [(fit.divergence, fit.time) for fit in fits]),
        (FEW, few),
    ):
        divergence, time = np.array(pairs).T
        yield (
            f"{name:24}{len(fits):6}{limit:7}{(divergence < TARGET).mean():10.3f}"
            f"{(divergence < 2.0 * TARGET).mean():10.3f}{divergence.max():9.2f}{time.mean():9.2f}"
            f"{np.median(time):9.2f}{(time < 1.0).mean():9.2f}"
        )


def draw(shown: dict[str, GridPosterior]) -> Figure:
    """Draw posteriors above their mixtures."""
    figure = new_figure(3.1 * len(shown), 6.4)
    panels = figure.subplots(2, len(shown), sharex=True, sharey=True)
    for (title, posterior), (upper, lower) in zip(shown.items(), panels.T, strict=True):
        constraint = extract_constraint(posterior)
        mixture = constraint.mixture
        own = mixture.cell_probabilities(posterior.bins)
        peak = posterior.log_prob.max()
        for axes, log_prob in ((upper, posterior.log_prob), (lower, np.log(own + 1e-300))):
            image = axes.imshow(
                (log_prob - peak).T,
                origin="lower",
                extent=(0.0, 360.0, 0.0, 360.0),
                cmap=COLORMAP,
                vmin=-SHOWN,
                vmax=0.0,
                interpolation="nearest",
            )
        heavy = mixture.weights > 0.01
        theta, phi = np.degrees(mixture.means[heavy]).T % 360.0
        lower.plot(theta, phi, "o", mfc="none", mec=VERMILION, label="modes of more than 1 %")
        upper.set_title(f"{title}\n“{constraint.kind}”", fontsize=10)
        number = mixture.num_components
        lower.set_title(
            f"{number} component{'s' if number != 1 else ''}, {constraint.divergence:.3f} nat",
            fontsize=10,
        )
        lower.set_xlabel("heading_l θ [deg]")
    ticks = np.arange(0, 361, 90)
    panels[0, 0].set(xlim=(0, 360), ylim=(0, 360), xticks=ticks, yticks=ticks)
    panels[0, 0].set_ylabel("posterior\nheading_r φ [deg]")
    panels[1, 0].set_ylabel("mixture\nheading_r φ [deg]")
    panels[1, 0].legend(loc="upper left", facecolor="0.25", labelcolor="white", fontsize=8)
    label = "log-probability below the posterior's maximum [nat]"
    figure.colorbar(image, ax=panels, label=label, shrink=0.6, extend="min")
    return figure


def typical(table: LikelihoodTable, rng: np.random.Generator) -> dict[str, GridPosterior]:
    """Choose one posterior a kind."""
    simulator = CorrespondenceSimulator()
    one = replace(simulator, mismatch=0.5).pair(25, rng)[0]
    shown = {"25 matches, half of them wrong": pose_posterior(one, table, temperature=0.5)}
    while True:
        pair = replace(simulator, mismatch=0.95).pair(100, rng)[0]
        posterior = pose_posterior(pair, table)
        constraint = extract_constraint(posterior)
        # one of those that are easy to see
        if constraint.kind == "headings" and constraint.mixture.num_components < FEW:
            shown["100 matches, 95 wrong"] = posterior
            break
    turn = turned(float(np.radians(66.0)), 40, rng)[0]
    shown["turn on the spot, 40 matches"] = pose_posterior(turn, table, temperature=0.3)
    wrong = replace(simulator, mismatch=1.0).pair(10, rng)[0]
    shown["10 matches, all wrong"] = pose_posterior(wrong, table)
    return shown


def main() -> None:
    """Fit, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="20 pairs a group instead of 100")
    parser.add_argument("--seed", type=int, default=1, help="of the pairs")
    parser.add_argument("--bins", type=int, default=128, help="of a heading (default: %(default)s)")
    parser.add_argument("--output", type=Path, default=Path("results/mixture_fits"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    pairs = 20 if arguments.quick else 100
    table = LikelihoodTable.default()
    rng = np.random.default_rng(arguments.seed)
    shown = typical(table, rng)
    save_figure(draw(shown), arguments.output / "mixture_fits.png")

    everything: dict[str, list[Fit]] = {"apart": [], "turned": []}
    rows = []
    print(
        f"{'pairs':8}{'T':>5}{'count':>6}{'mismatch':>9}{'pairs':>6}{'constrain':>12}{'all':>9}"
        f"{'of those':>10}{'limit 16':>10}{'median':>9}{'comp.':>7}{'ms':>9}{'median':>9}"
        f"{'ms of 16':>9}"
    )
    total = len(TEMPERATURES) * pairs * (len(COUNTS) * len(MISMATCHES) + len(TURNED))
    with tqdm(total=total, unit="pair", disable=None) as bar:
        for temperature in TEMPERATURES:
            for views, count, share, listed in groups(pairs, arguments.seed):
                fits = []
                for correspondences, *truth in listed:
                    posterior = pose_posterior(
                        correspondences, table, bins=arguments.bins, temperature=temperature
                    )
                    fits.append(measure(posterior, *truth))
                    bar.update()
                everything[views] += fits
                name = (views, temperature, count, share)
                rows += [(*name, *fit.row()) for fit in fits]
                tqdm.write(f"{views:8}{temperature:5}{count:6}{share:9.2f}{summary(fits)}")
    for views, fits in everything.items():
        print(f"{views:28}{summary(fits)}")
        for kind in KINDS:
            chosen = [fit for fit in fits if fit.constraint.kind == kind]
            if chosen:
                loss = np.mean([fit.loss for fit in chosen])
                print(f"  {kind:26}{summary(chosen)}   log-density lost: {loss:.3f} nat")
    useful = [fit for fit in everything["apart"] if fit.constraint.kind != "none"]
    number = np.array([fit.constraint.mixture.num_components for fit in useful])
    print(
        f"\n{'pairs':24}{'':6}{'limit':>7}{'< 0.05':>10}{'< 0.1':>10}{'largest':>9}{'ms':>9}"
        f"{'median':>9}{'< 1 ms':>9}"
    )
    for name, fits in (("apart, constraining", useful), *everything.items()):
        print("\n".join(limits(name, fits)))
    for name, fits in everything.items():
        time = np.array([fit.time_extract for fit in fits])
        print(f"extract_constraint, {name}: {time.mean():.2f} ms, median {np.median(time):.2f}")
    for low, high in ((1, 1), (0, 2), (FEW + 1, MAX_COMPONENTS)):
        chosen = (number >= low) & (number <= high)
        time = np.mean([fit.time for fit, take in zip(useful, chosen, strict=True) if take])
        print(f"constraining, {low} to {high} components: {chosen.mean():.2f}, {time:.2f} ms")
    kinds = Counter(
        (temperature, count, kind)
        for views, temperature, count, _, kind, *_ in rows
        if views == "turned"
    )
    print("turned:", ", ".join(f"T {t}, {n}: {kinds[t, n, kind]} {kind}" for t, n, kind in kinds))
    write_csv(arguments.output / "mixture_fits.csv", COLUMNS, rows)
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
