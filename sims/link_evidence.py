"""Do two images show one place? The probability of a link: learned, and checked.

    python sims/link_evidence.py [--quick] [--ahead] [--real PATH ...] [--output DIR]

Learns the models that come with pflut from all pairs of the images of rendered homes 100 to 111,
every other image, and checks them on homes 200 to 209, on simulated drives through homes of
landmarks, and on real datasets. What is linked is said in `pflut.mapping.true_links`. Per set:

evidence    the log-evidence of the matches, nothing learned
model       the probability of the learned model, with the same table; "own" is one learned from
            other pairs of the same kind: drives in other homes, the first half of a drive on a road
RANSAC      inliers of pflut's 2-point and 3-point RANSAC, with four noises, and for cameras that
            look ahead of OpenCV's essential matrix (MAGSAC), with four thresholds; the best of them
            is chosen on the very pairs that it is compared on
matches     their number

Prints average precisions with 95 % intervals by bootstrap over images (and homes), those of their
differences from the best RANSAC, and the expected calibration errors. Writes the models, a CSV and
two figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pflut import Correspondences, LikelihoodTable, load_dataset, match, ransac_relative_poses
from pflut._files import write_csv
from pflut.camera import Perspective
from pflut.comparison import NOISES
from pflut.datasets import Dataset, load_simulated_home
from pflut.features import FeatureCache, Features
from pflut.geometry import bearing_vectors, wrap_to_pi
from pflut.mapping.link_evidence import LinkEvidence, link_evidence
from pflut.mapping.link_model import AHEAD as AHEAD_FEATURES
from pflut.mapping.link_model import ALL_AROUND, LinkModel
from pflut.mapping.true_links import INDOORS, ON_ROADS, dataset_links, true_links
from pflut.plot import plot_precision_recall, plot_reliability, save_figure
from pflut.reliability import (
    average_precision,
    draws_of_groups,
    draws_of_pairs,
    expected_calibration_error,
    precision_recall,
    reliability_curve,
)
from pflut.replay.options import ReplayOptions
from pflut.replay.pipeline import make_extractor
from pflut.simulation.landmark_drive import simulate_drive

LEARNED, CHECKED = range(100, 112), range(200, 210)
LANDMARK_DRIVES = {"landmarks": "global", "landmarks, 90 % mismatches": "mismatches"}
#: Of the camera that looks ahead; of a car's, about KITTI's.
AHEAD = float(np.radians(82.0))
#: Of views as narrow as that, less is common to two.
AHEAD_RULE = replace(INDOORS, min_overlap=ON_ROADS.min_overlap)
#: The table of each model.
TABLES = {"panorama": "panorama", "home": "home", "perspective": "panorama"}
#: What each model weighs.
FEATURES = {"panorama": ALL_AROUND, "home": ALL_AROUND, "perspective": AHEAD_FEATURES}
RESAMPLES = 1000
FEWEST = 5  # pairs of a class that is drawn
PIXELS = (0.5, 1.0, 2.0, 4.0)
COLUMNS = ["set", "pairs", "linked", "score", "ap", "low", "high", "gain", "gain_low", "gain_high"]


@dataclass(frozen=True, eq=False)
class Measured:
    """Pairs of images, whether they are linked, and what speaks for it.

    `ends` are the images of each pair, other numbers in every home; `homes` the home's number.
    """

    name: str
    linked: np.ndarray
    ends: np.ndarray
    homes: np.ndarray
    evidence: Mapping[str, LinkEvidence]
    scores: Mapping[str, np.ndarray]
    own: LinkModel | None = None

    @property
    def first(self) -> LinkEvidence:
        """The evidence of the first table."""
        return next(iter(self.evidence.values()))

    def learned_from(self, other: Measured) -> Measured:
        """Return the same with a model learned from other pairs."""
        features = FEATURES[next(iter(other.evidence))]
        return replace(self, own=LinkModel.learn(other.first, other.linked, features=features))

    def part(self, name: str, chosen: np.ndarray) -> Measured:
        """Return some of the pairs."""
        return Measured(
            name,
            self.linked[chosen],
            self.ends[chosen],
            self.homes[chosen],
            {key: evidence[chosen] for key, evidence in self.evidence.items()},
            {key: score[chosen] for key, score in self.scores.items()},
        )

    def probabilities(
        self, models: Mapping[str, LinkModel], prior: float | None = None
    ) -> dict[str, np.ndarray]:
        """Give the probabilities of all models by name."""
        found = {
            f"model {name}": models[name].probability(evidence, prior=prior)
            for name, evidence in self.evidence.items()
        }
        if self.own is not None:
            found["model own"] = self.own.probability(self.first, prior=prior)
        return found

    @classmethod
    def pooled(cls, name: str, parts: Sequence[Measured]) -> Measured:
        """Take the pairs of several homes together."""
        starts = np.cumsum([0, *(part.ends.max() + 1 for part in parts)])
        return cls(
            name,
            np.concatenate([part.linked for part in parts]),
            np.concatenate([part.ends + k for part, k in zip(parts, starts, strict=False)]),
            np.repeat(np.arange(len(parts)), [len(part.linked) for part in parts]),
            {
                key: LinkEvidence.concatenate([part.evidence[key] for part in parts])
                for key in parts[0].evidence
            },
            {key: np.concatenate([part.scores[key] for part in parts]) for key in parts[0].scores},
        )

    def draws(self) -> np.ndarray:
        """Say how often bootstraps over images, and over homes if there are several, draw each."""
        stream = np.random.default_rng([len(self.linked), len(self.homes)])
        drawn = draws_of_pairs(self.ends, resamples=RESAMPLES, rng=stream)
        number = int(self.homes.max()) + 1
        if number > 1:
            times = draws_of_groups(number, resamples=RESAMPLES, rng=stream)
            drawn = drawn * times[:, self.homes].astype(np.int16)
        return drawn


def measure(
    name: str,
    pairs: Sequence[Correspondences],
    linked: np.ndarray,
    ends: np.ndarray,
    models: Sequence[str],
    camera: Perspective | None = None,
    rivals: bool = True,
) -> Measured:
    """Collect all evidence and scores of some pairs."""
    evidence = {
        model: link_evidence(pairs, LikelihoodTable.default(TABLES[model])) for model in models
    }
    scores: dict[str, np.ndarray] = {"matches": np.array(list(map(len, pairs)), dtype=float)}
    if rivals:
        for solver in ("2pt", "3pt"):
            for noise in NOISES:
                poses = ransac_relative_poses(pairs, solver=solver, noise=noise)
                inliers = [float(pose.num_inliers) for pose in poses]
                scores[f"RANSAC {solver}, {noise:g} rad"] = np.array(inliers)
        if camera is not None:
            for pixels in PIXELS:
                count = partial(essential_inliers, threshold=pixels / camera.fx)
                scores[f"RANSAC essential, {pixels:g} px"] = np.array(list(map(count, pairs)))
    homes = np.zeros(len(pairs), np.intp)
    return Measured(name, linked, np.asarray(ends), homes, evidence, scores)


def essential_inliers(pair: Correspondences, threshold: float) -> float:
    """Count the inliers of OpenCV's essential matrix; the focal length is one."""
    import cv2

    if len(pair) < 5:
        return 0.0
    views = (
        bearing_vectors(pair.azimuth_l, pair.elevation_l),
        bearing_vectors(pair.azimuth_r, pair.elevation_r),
    )
    points = [np.ascontiguousarray(-v[:, 1:] / v[:, :1]) for v in views]
    _, mask = cv2.findEssentialMat(
        *points, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.999, threshold=threshold
    )
    return 0.0 if mask is None else float(np.count_nonzero(mask))


def features_of(dataset: Dataset, every: int) -> dict[int, Features]:
    """Extract the features of every n-th image."""
    extractor, cache = make_extractor(dataset, ReplayOptions()), FeatureCache()
    images = range(0, len(dataset), every)
    return {
        i: cache(extractor, dataset.image(i)) for i in tqdm(images, desc=dataset.name, disable=None)
    }


def looking_ahead(features: Features) -> Features:
    """Keep what a camera would see that looks ahead."""
    return features[np.abs(wrap_to_pi(features.azimuth)) <= 0.5 * AHEAD]


def matched(features: Mapping[int, Features], ends: np.ndarray) -> list[Correspondences]:
    """Match pairs of images."""
    return [
        match(features[left], features[right], mutual=True)
        for left, right in tqdm(ends.tolist(), desc="matching", unit="pair", disable=None)
    ]


def of_dataset(dataset: Dataset, every: int, models: Sequence[str], rivals: bool) -> Measured:
    """Measure all pairs of every n-th image of a dataset."""
    features = features_of(dataset, every)
    ends = np.array(list(combinations(features, 2)))
    linked = dataset_links(dataset, ends)
    camera = dataset.camera if isinstance(dataset.camera, Perspective) else None
    pairs = matched(features, ends)
    return measure(dataset.name, pairs, linked, ends, models, camera, rivals)


def ahead_in(dataset: Dataset, every: int, rivals: bool) -> Measured:
    """Measure the same of a camera that looks ahead."""
    features = {i: looking_ahead(some) for i, some in features_of(dataset, every).items()}
    ends = np.array(list(combinations(features, 2)))
    linked = true_links(
        dataset.ground_truth, ends, dataset.floor_plan, rule=AHEAD_RULE, field_of_view=AHEAD
    )
    return measure(
        dataset.name, matched(features, ends), linked, ends, ["perspective"], None, rivals
    )


def of_landmarks(
    name: str, scenario: str, seeds: Sequence[int], every: int, rivals: bool
) -> Measured:
    """Measure the pairs of a reference and an image of simulated drives, a home each."""
    parts = []
    for seed in tqdm(seeds, desc=name, unit="drive", disable=None):
        drive = simulate_drive(scenario, seed, home_seed=seed)
        references = len(drive.reference_poses)
        images = range(0, len(drive), every)
        pairs = [pair for i in images for pair in drive.correspondences(i)]
        ends = np.array([(k, references + i) for i in images for k in range(references)])
        poses = np.concatenate([drive.reference_poses, drive.ground_truth])
        linked = true_links(poses, ends, drive.home.walls)
        parts.append(measure(name, pairs, linked, ends, ["panorama"], rivals=rivals))
    return Measured.pooled(name, parts)


def of_strangers(features: Sequence[Mapping[int, Features]], number: int) -> LinkEvidence:
    """Collect the evidence for links of images of different homes, of which there are none."""
    rng = np.random.default_rng(0)
    pairs = []
    for _ in tqdm(range(number), desc="different homes", unit="pair", disable=None):
        homes = rng.choice(len(features), 2, replace=False)
        left, right = (features[home][rng.choice(list(features[home]))] for home in homes)
        pairs.append(match(left, right, mutual=True))
    return link_evidence(pairs, LikelihoodTable.default("home"))


def learn(name: str, parts: Sequence[Measured], path: Path) -> LinkModel:
    """Learn a model and write it."""
    all_pairs = Measured.pooled(name, parts)
    model = LinkModel.learn(
        all_pairs.evidence[name],
        all_pairs.linked,
        learned_from={
            "source": "rendered homes",
            "homes": [part.name.split()[-1] for part in parts],
            "table": TABLES[name],
            "rule": vars(AHEAD_RULE if name == "perspective" else INDOORS),
        },
        features=FEATURES[name],
    )
    model.save(path)
    print(f"{name}: weights {np.round(model.weights, 3)}, {all_pairs.linked.mean():.3f} linked")
    return model


def judge(measured: Measured, models: Mapping[str, LinkModel]) -> Iterator[list[Any]]:
    """Give the rows of the CSV: average precisions, and what they are above the best RANSAC."""
    linked, draws = measured.linked, measured.draws()
    scores = all_scores(measured, models)
    rival = best_ransac(measured)
    resampled = {}
    for name, score in scores.items():
        if name.startswith("RANSAC") and name != rival:
            continue
        order = np.argsort(-score, kind="stable")  # sorted once, it is sorted fast
        yes, value = linked[order], score[order]
        resampled[name] = np.array(
            [average_precision(yes, value, weights=times[order]) for times in draws]
        )
    best = average_precision(linked, scores[rival])
    for name, values in resampled.items():
        found = average_precision(linked, scores[name])
        yield [
            measured.name,
            len(linked),
            linked.mean(),
            name,
            found,
            *np.nanquantile(values, (0.025, 0.975)),
            found - best,
            *np.nanquantile(values - resampled[rival], (0.025, 0.975)),
        ]


def all_scores(measured: Measured, models: Mapping[str, LinkModel]) -> dict[str, np.ndarray]:
    """Give all scores of a set by name."""
    evidence = {
        f"evidence, {TABLES[name]} table": evidence.log_evidence
        for name, evidence in measured.evidence.items()
    }
    return evidence | measured.probabilities(models) | dict(measured.scores)


def best_ransac(measured: Measured) -> str:
    """Give the name of the RANSAC that is best on these very pairs."""
    return max(
        (name for name in measured.scores if name.startswith("RANSAC")),
        key=lambda name: average_precision(measured.linked, measured.scores[name]),
    )


def calibrated(measured: Measured, models: Mapping[str, LinkModel]) -> None:
    """Print the calibration errors of a set."""
    linked, draws = measured.linked, measured.draws()
    for prior in (None, float(linked.mean())):
        for name, given in measured.probabilities(models, prior).items():
            error: Callable[..., float] = partial(expected_calibration_error, given, linked)
            low, high = np.nanquantile([error(weights=w) for w in draws], (0.025, 0.975))
            inner = np.unique(np.quantile(given, np.linspace(0.1, 0.9, 9)))
            asked = "prior as learned" if prior is None else "its own share"
            print(f"{measured.name:28}{name:20}{asked:18}ECE {error():.3f}", end="")
            print(f" ({low:.3f} to {high:.3f}), ", end="")
            print(f"classes of equal size {error(edges=[0.0, *inner, 1.0]):.3f}")


def main() -> None:
    """Learn and check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two homes each, fewer images")
    parser.add_argument("--ahead", action="store_true", help="only cameras that look ahead")
    parser.add_argument("--real", nargs="+", default=[], metavar="PATH", help="real datasets")
    parser.add_argument("--output", type=Path, default=Path("results/link_evidence"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    every, few = (6, slice(2)) if arguments.quick else (2, slice(None))
    both = ["home", "panorama"]
    known = [load_simulated_home(seed) for seed in LEARNED[few]]
    parts = {"perspective": [ahead_in(home, every, rivals=False) for home in known]}
    if not arguments.ahead:
        parts["home"] = [of_dataset(home, every, both, rivals=False) for home in known]
        parts["panorama"] = parts["home"]
    models = {
        name: learn(name, some, arguments.output / f"links_{name}.json")
        for name, some in parts.items()
    }
    unseen = [load_simulated_home(seed) for seed in CHECKED[few]]
    ahead = Measured.pooled(
        "rendered homes, 82 degrees", [ahead_in(home, every, rivals=True) for home in unseen]
    )
    sets = [ahead]
    if not arguments.ahead:
        by_home = [of_dataset(home, every, both, rivals=True) for home in unseen]
        sets.insert(0, Measured.pooled("rendered homes", by_home))
        for name, scenario in LANDMARK_DRIVES.items():
            rare = 6 if arguments.quick else 3
            checked, others = (
                of_landmarks(name, scenario, seeds[few][:4], rare, rivals=seeds is CHECKED)
                for seeds in (CHECKED, LEARNED)
            )
            sets.append(checked.learned_from(others))
    for path in arguments.real:
        dataset = load_dataset(path)
        if not isinstance(dataset.camera, Perspective):
            if not arguments.ahead:
                sets.append(of_dataset(dataset, 1, both, rivals=True))
            continue
        road = of_dataset(dataset, 6 if arguments.quick else 3, ["perspective"], rivals=True)
        late = road.ends >= len(dataset) // 2
        first, second = (
            road.part(f"{road.name}, 2nd half", half.all(axis=1)) for half in (~late, late)
        )
        sets += [road, second.learned_from(first)]
    rows = [
        row for some in tqdm(sets, desc="bootstrap", disable=None) for row in judge(some, models)
    ]
    write_csv(arguments.output / "average_precision.csv", COLUMNS, rows)
    print("\naverage precision (over images), and its difference from the best RANSAC's")
    for name, pairs, share, score, *numbers in rows:
        print(f"{name:28}{pairs:6} pairs, {share:.3f} linked  {score:28}", end="")
        print("{:.3f} ({:.3f} to {:.3f})  {:+.3f} ({:+.3f} to {:+.3f})".format(*numbers))
    print()
    for some in sets:
        calibrated(some, models)
    if not arguments.ahead:
        of_rooms(by_home, [features_of(home, every) for home in unseen], models, arguments.quick)
        draw(sets[0], sets, models, arguments.output)
    print(f"\nwritten: {arguments.output}")


def of_rooms(
    by_home: Sequence[Measured],
    features: Sequence[Mapping[int, Features]],
    models: Mapping[str, LinkModel],
    quick: bool,
) -> None:
    """Print how much homes differ, and what is said of pairs of images of different ones."""
    errors = [
        expected_calibration_error(models["home"].probability(part.evidence["home"]), part.linked)
        for part in by_home
    ]
    print(f"each home by itself, model home: ECE {min(errors):.3f} to {max(errors):.3f}")
    strangers = of_strangers(features, 400 if quick else 4000)
    given = models["home"].probability(strangers)
    print(f"images of different homes: {(given > 0.5).mean():.4f} above 0.5, ", end="")
    print(f"{(given > 0.9).mean():.4f} above 0.9, the mean is {given.mean():.3f}")


def draw(
    homes: Measured, sets: Sequence[Measured], models: Mapping[str, LinkModel], output: Path
) -> None:
    """Draw the reliability of the models, and precision over recall in rendered homes."""
    curves = {}
    for some in sets:
        found = some.probabilities(models)
        name, given = next(iter(found.items())) if some.own is None else found.popitem()
        groups = some.homes if some.homes.max() else None
        curve = reliability_curve(given, some.linked, groups=groups)
        curves[f"{some.name}: {name}"] = [part for part in curve if part.count >= FEWEST]
    save_figure(plot_reliability(curves, what="pairs that are linked"), output / "reliability.png")
    scores = all_scores(homes, models)
    shown = ["model home", "evidence, home table", best_ransac(homes), "matches"]
    save_figure(
        plot_precision_recall(
            {name: precision_recall(homes.linked, scores[name]) for name in shown},
            title=f"{homes.name}: {len(homes.linked)} pairs",
        ),
        output / "precision_recall.png",
    )


if __name__ == "__main__":
    main()
