"""Topological maps of rendered homes: whether places are rooms, and localization in them.

    python sims/topological_map.py [--quick] [--seed N] [--homes N] [--output DIR]

Links all pairs of the images of each home's mapping drive, makes a topological map of them, and
compares its places with the rooms by the adjusted Rand index, and the directions of its links with
the truth. Localizes the images of the test drive (another day, another light) in that map,
globally lost. A node is right if it stands within 1 m of the image and in the same room. Beside
each other:

retrieval            the node whose visual words are most like the image's
most matches         of the nodes that the filter's retrieval proposes
most probable link   of the same, by the link model
most evidence        of the same
filter               the most probable node, with odometry
filter, no odometry  the same, which knows no distances
place                the most probable place is that of the nearest node in the room

Prints the shares with 95 % intervals by bootstrap over homes. Links are kept in the output folder,
and used again. Writes a CSV of all images and a figure of the first home.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pflut import LikelihoodTable, all_pairs
from pflut._files import write_csv
from pflut.datasets import Dataset, load_simulated_home
from pflut.features import FeatureCache
from pflut.geometry import relative_headings, wrap_to_pi
from pflut.likelihood.sampling import available_cores
from pflut.mapping.all_pairs import dataset_features
from pflut.mapping.link_model import LinkModel
from pflut.mapping.node_localizer import NodeLocalizer
from pflut.mapping.node_model import NodeModel
from pflut.mapping.topological_map import TopologicalMap
from pflut.plot import plot_places, save_figure
from pflut.reliability import share_interval
from pflut.simulation.home import Home, rooms_at
from pflut.statistics import adjusted_rand_index

NEAR = 1.0
WAYS = (
    "retrieval",
    "most matches",
    "most probable link",
    "most evidence",
    "filter",
    "filter, no odometry",
)
RESAMPLES = 10_000
TURN = np.radians(15.0)
RESOLUTIONS = (0.5, 1.0, 2.0)


def localize(dataset: Dataset, node_model: NodeModel, features: list) -> np.ndarray:
    """Give a row an image: the node that each way finds, the place and two probabilities."""
    link_model = LinkModel.default()
    filters = [NodeLocalizer(node_model.topological_map, node_model) for _ in range(2)]
    rows = []
    for number, query in enumerate(dataset.query_indices):
        image = features[query]
        single = node_model.match(None, image)
        scores = (
            single.evidence.num_matches,
            link_model.log_odds(single.evidence),
            single.evidence.log_evidence,
        )
        row = [float(np.argmax(node_model.similarity(image)))]
        row += [float(single.nodes[np.argmax(score)]) for score in scores]
        if number:
            before = dataset.query_indices[number - 1]
            filters[0].predict(dataset.odometry_between(int(before), int(query)))
            filters[1].predict()
        estimates = [one.update(image) for one in filters]
        row += [float(estimate.node) for estimate in estimates]
        row += [float(estimates[0].place), estimates[0].probability, estimates[0].place_probability]
        rows.append(row)
    return np.array(rows)


def measure(seed: int, arguments: argparse.Namespace) -> tuple[list[list], dict[str, Any]]:
    """Make the map of a home and localize its test drive."""
    dataset, home = load_simulated_home(seed), Home.generate(seed)
    table = LikelihoodTable.default()
    features = list(dataset_features(dataset, cache=FeatureCache()))
    references = dataset.reference_indices
    links = all_pairs(
        [features[i] for i in references],
        arguments.output / f"home_{seed}",
        table,
        jobs=arguments.jobs,
    )
    made = TopologicalMap.from_links(links, len(references))
    assert dataset.ground_truth is not None
    nodes, images = dataset.ground_truth[references], dataset.ground_truth[dataset.query_indices]
    rooms, seen_rooms = rooms_at(home, nodes), rooms_at(home, images)
    about: dict[str, Any] = {
        "rooms": len(home.rooms),
        "places": made.num_places,
    } | {
        f"agreement at {resolution:g}": adjusted_rand_index(
            made.with_places(resolution=resolution).places, rooms
        )
        for resolution in RESOLUTIONS
    }
    first, second = made.edges.T
    true_l, true_r, _ = relative_headings(nodes[first], nodes[second])
    about["heading errors"] = np.abs(wrap_to_pi(made.headings - np.column_stack([true_l, true_r])))
    if seed == arguments.seed:
        save_figure(
            plot_places(
                nodes,
                made.places,
                made.edges,
                made.probability,
                dataset,
                title=f"{dataset.name}: {len(made)} images, {len(made.edges)} links",
            ),
            arguments.output / "topological_map.png",
        )
    found = localize(dataset, NodeModel(made, [features[i] for i in references], table), features)
    chosen = found[:, : len(WAYS)].astype(np.intp)
    distance = np.hypot(*(nodes[chosen, :2] - images[:, None, :2]).T).T
    right = (distance <= NEAR) & (rooms[chosen] == seen_rooms[:, None])
    # the node that the image should be at: the nearest one in its room
    away = np.hypot(*(images[:, None, :2] - nodes[:, :2]).transpose(2, 0, 1))
    away[rooms != seen_rooms[:, None]] = np.inf
    nearest = away.argmin(axis=1)
    in_place = found[:, len(WAYS)] == made.places[nearest]
    about["possible"] = float((away.min(axis=1) <= NEAR).mean())
    rows = [
        [seed, number, *map(int, ways), int(place), *values]
        for number, (ways, place, values) in enumerate(
            zip(right, in_place, found[:, len(WAYS) + 1 :].tolist(), strict=True)
        )
    ]
    return rows, about


def with_interval(values: np.ndarray, homes: np.ndarray) -> str:
    """Give a mean over images with its interval by bootstrap over homes."""
    _, of = np.unique(homes, return_inverse=True)
    low, high = share_interval(np.bincount(of, values), np.bincount(of), resamples=RESAMPLES)
    return f"{values.mean():.3f} [{low:.3f}, {high:.3f}]"


def main() -> None:
    """Measure homes one after the other and print what they have in common."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=200, help="of the first home")
    parser.add_argument("--homes", type=int, default=10, help="(default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=available_cores(), help="processes")
    parser.add_argument("--quick", action="store_true", help="2 homes")
    parser.add_argument("--output", type=Path, default=Path("results/topological_map"))
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + (2 if arguments.quick else arguments.homes))
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows: list[list] = []
    print(f"{'home':>6}{'rooms':>7}{'places':>8}{'agreement':>11}{'filter right':>14}")
    agreements: dict[float, list[float]] = {resolution: [] for resolution in RESOLUTIONS}
    headings = []
    for seed in tqdm(seeds, unit="home", disable=None):
        new, about = measure(seed, arguments)
        rows += new
        headings.append(about["heading errors"])
        for resolution, values in agreements.items():
            values.append(about[f"agreement at {resolution:g}"])
        share = np.mean([row[2 + WAYS.index("filter")] for row in new])
        print(
            f"{seed:>6}{about['rooms']:>7}{about['places']:>8}{about['agreement at 1']:>11.3f}"
            f"{share:>14.3f}   (possible {about['possible']:.3f})",
            flush=True,
        )
    columns = ["home", "image", *WAYS, "place", "probability", "place_probability"]
    write_csv(arguments.output / "topological_map.csv", columns, rows)
    print("\nplaces and rooms, adjusted Rand index: median, least and largest of the homes")
    for resolution, values in agreements.items():
        low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
        print(f"resolution {resolution:<11g}{middle:.3f}, {low:.3f} to {high:.3f}")
    errors = np.concatenate(headings)
    known = errors[np.isfinite(errors).all(axis=1)].ravel()
    print(
        f"\n{len(errors)} links, {len(known) / errors.size:.3f} of them with headings; error: "
        f"median {np.degrees(np.median(known)):.2f} deg, {np.mean(known < TURN):.3f} within 15 deg"
    )
    print(f"\nof {len(rows)} images the right node; last, the place of the nearest node")
    column = dict(zip(columns, np.array(rows, dtype=np.float64).T, strict=True))
    for name in (*WAYS, "place"):
        print(f"{name:<22}{with_interval(column[name], column['home'])}")
    print("the filter's share minus that of")
    for name in WAYS[:4]:
        gain = with_interval(column["filter"] - column[name], column["home"])
        print(f"{name:<22}{gain}")
    for name, right in (("probability", "filter"), ("place_probability", "place")):
        sure = column[name] > 0.9
        wrong = (sure & (column[right] == 0)).sum()
        print(f"{name} above 0.9: {sure.sum()} images, {wrong} of them wrong")


if __name__ == "__main__":
    main()
