"""The model of links: SciPy as oracle, weights that are known, its file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evidence import some_evidence

from pflut.camera import EquirectangularPanorama, Perspective
from pflut.correspondences import Correspondences
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.link_evidence import LinkEvidence, link_evidence
from pflut.mapping.link_model import (
    AHEAD,
    ALL_AROUND,
    LEAST_ROTATION_STD,
    RIDGE,
    LinkModel,
    link_features,
    link_model_name,
)
from pflut.mapping.true_links import true_links
from pflut.reliability import average_precision, expected_calibration_error
from pflut.simulation.landmark_drive import simulate_drive

SIGMAS = 5.0


KNOWN = LinkModel([1.2, -0.8, 6.0], -2.5, 0.5)
KNOWN_AHEAD = LinkModel([1.2, -0.8, 2.0, 1.5, 1.0, -0.3], -3.5, 0.5, features=AHEAD)


def drawn(
    number: int, seed: int = 0, truth: LinkModel = KNOWN
) -> tuple[LinkEvidence, np.ndarray, LinkModel]:
    """Pairs whose links are drawn by a known model."""
    rng = np.random.default_rng(seed)
    matches = rng.integers(5, 100, number)
    evidence = some_evidence(
        rng.exponential(20.0, number) - 2.0,
        matches,
        rng.integers(0, 12, number),
        num_inliers=rng.integers(0, matches + 1),
        spread=rng.uniform(0.0, 1.4, number),
        rotation=rng.uniform(-np.pi, np.pi, number),
        rotation_std=rng.lognormal(-4.0, 1.0, number),
    )
    return evidence, rng.random(number) < truth.probability(evidence), truth


@pytest.mark.parametrize("truth", [KNOWN, KNOWN_AHEAD])
def test_a_known_model_is_learned(truth: LinkModel) -> None:
    evidence, linked, truth = drawn(20_000, truth=truth)
    model = LinkModel.learn(evidence, linked, features=truth.features)
    weighed = link_features(evidence, truth.features)
    features = np.column_stack([weighed, np.ones(len(linked))])
    p = truth.probability(evidence)
    information = (features * (p * (1.0 - p))[:, None]).T @ features
    spread = np.sqrt(np.diag(np.linalg.inv(information)))
    found, expected = np.append(model.weights, model.bias), np.append(truth.weights, truth.bias)
    assert (np.abs(found - expected) < SIGMAS * spread).all()
    assert model.prior == pytest.approx(linked.mean())
    assert expected_calibration_error(model.probability(evidence), linked) < 0.01
    assert model.learned_from == {"pairs": 20_000, "linked": int(linked.sum())}


def test_learning_is_scipys_minimum() -> None:
    from scipy.optimize import minimize

    evidence, linked, _ = drawn(300, seed=1)
    raw = link_features(evidence)
    scaled = np.column_stack([(raw - raw.mean(0)) / raw.std(0), np.ones(300)])

    def loss(weights: np.ndarray) -> float:
        odds = scaled @ weights
        penalty = 0.5 * RIDGE * weights[:-1] @ weights[:-1]
        return float(np.sum(np.logaddexp(0.0, odds) - linked * odds) + penalty)

    oracle = minimize(loss, np.zeros(4), method="BFGS", options={"gtol": 1e-8})
    found = LinkModel.learn(evidence, linked).log_odds(evidence)
    np.testing.assert_allclose(found, scaled @ oracle.x, atol=1e-4)


def test_weights_are_repetitions() -> None:
    evidence, linked, _ = drawn(200, seed=2)
    times = np.random.default_rng(3).integers(3, size=200)
    rows = np.repeat(np.arange(200), times)
    weighted = LinkModel.learn(evidence, linked, weights=times)
    repeated = LinkModel.learn(evidence[rows], linked[rows])
    np.testing.assert_allclose(weighted.weights, repeated.weights, rtol=1e-6)
    assert weighted.prior == pytest.approx(repeated.prior)


def test_pairs_that_can_be_told_apart_give_finite_weights() -> None:
    evidence = some_evidence([0.0, 0.0, 50.0, 50.0], 20, 2)
    given = LinkModel.learn(evidence, [False, False, True, True]).probability(evidence)
    assert (given[:2] < 0.5).all() and (given[2:] > 0.5).all()
    # what is the same in all pairs has no say
    assert LinkModel.learn(evidence, [False, False, True, True]).weights[1:].tolist() == [0.0, 0.0]


def test_another_prior_moves_the_odds_by_its_own() -> None:
    evidence, _, model = drawn(50, seed=4)
    odds = model.probability(evidence) / (1.0 - model.probability(evidence))
    rare = model.probability(evidence, prior=0.01)
    assert rare / (1.0 - rare) == pytest.approx(odds / 99.0)
    assert (model.probability(evidence, prior=model.prior) == model.probability(evidence)).all()


def test_a_pair_has_the_same_probability_in_any_company() -> None:
    evidence, _, model = drawn(257, seed=5)
    together = model.probability(evidence)
    alone = [model.probability(evidence[k : k + 1])[0] for k in range(257)]
    assert together.tolist() == alone


@pytest.mark.parametrize("name", ["panorama", "home", "perspective"])
def test_the_shipped_models_believe_what_speaks_for_a_link(name: str) -> None:
    model = LinkModel.default(name)  # type: ignore[arg-type]
    assert 0.0 < model.prior < 0.5 and model.learned_from["homes"][0] == "100"
    evidence = some_evidence(
        [0.0, 5.0, 50.0, 50.0],
        20,
        [0, 3, 3, 12],
        num_inliers=[0, 5, 15, 15],
        spread=[0.0, 0.3, 0.3, 0.4],
        rotation=[3.0, 1.0, 0.2, 0.2],
        rotation_std=[0.5, 0.05, 0.01, 0.01],
    )
    given = model.probability(evidence)
    assert (np.diff(given) > 0.0).all()
    assert given[0] < 0.2
    with pytest.raises(ValueError, match="name: expected one of panorama, home, perspective"):
        LinkModel.default("town")  # type: ignore[arg-type]


def test_ahead_no_direction_but_a_turn_counts() -> None:
    model = LinkModel.default("perspective")
    assert model.features == AHEAD
    few, many = model.log_odds(some_evidence([50.0, 50.0], 40, [1, 5], num_inliers=30))
    assert few == many
    for name, values in (
        ("rotation", [0.0, 0.8]),
        ("rotation", [0.0, -0.8]),
        ("rotation_std", [0.005, 0.05]),
        ("spread", [0.4, 0.1]),
        ("num_inliers", [35, 20]),
    ):
        others: dict[str, Any] = {"num_inliers": 30} | {name: values}
        more, less = model.log_odds(some_evidence([50.0, 50.0], 40, **others))
        assert more > less


def test_features_are_what_they_say() -> None:
    evidence = some_evidence(
        [3.0, -3.0], [4, 0], 8, num_inliers=[3, 0], spread=0.5, rotation=2.0, rotation_std=[0.1, 0]
    )
    found = link_features(evidence, [*AHEAD, "num_directions"])
    expected = [
        [np.arcsinh(3.0), np.log(5.0), 0.75, 0.5, np.cos(2.0), np.log(0.1), 0.5],
        [-np.arcsinh(3.0), 0.0, 0.0, 0.5, np.cos(2.0), np.log(LEAST_ROTATION_STD), 0.5],
    ]
    np.testing.assert_allclose(found, expected)
    assert (link_features(evidence) == link_features(evidence, ALL_AROUND)).all()
    for names in ([], ["luck"], "spread", [["spread"]]):
        with pytest.raises(ValueError, match="features: expected some of log_evidence, num_matche"):
            link_features(evidence, names)  # type: ignore[arg-type]


def test_a_model_is_named_where_it_is_known_to_hold() -> None:
    around = EquirectangularPanorama(360, 180)
    ahead = Perspective(200, 100, fx=100.0, fy=100.0, cx=99.5, cy=49.5)
    named = [link_model_name(table, around) for table in ("default", "home", "perspective")]
    assert named == ["panorama", "home", None]
    assert link_model_name("default", ahead) is None


def landmark_pairs(home: int) -> tuple[list[Correspondences], np.ndarray]:
    """The pairs of a reference and an image of a simulated drive, and whether they are linked."""
    drive = simulate_drive("global", home, home_seed=home)
    references, images = len(drive.reference_poses), range(0, len(drive), 4)
    pairs = [pair for i in images for pair in drive.correspondences(i)]
    ends = [(k, references + i) for i in images for k in range(references)]
    poses = np.concatenate([drive.reference_poses, drive.ground_truth])
    return pairs, true_links(poses, ends, drive.home.walls)


def test_a_model_learned_in_some_homes_is_calibrated_in_another() -> None:
    table = LikelihoodTable.default()
    found = [(link_evidence(pairs, table), yes) for pairs, yes in map(landmark_pairs, (1, 2, 3))]
    known = LinkEvidence.concatenate([evidence for evidence, _ in found[:2]])
    model = LinkModel.learn(known, np.concatenate([yes for _, yes in found[:2]]))
    evidence, linked = found[2]
    given = model.probability(evidence)
    assert expected_calibration_error(given, linked) < 0.1
    assert average_precision(linked, given) > average_precision(linked, evidence.num_matches) + 0.05


def test_its_file(tmp_path: Path) -> None:
    evidence, linked, _ = drawn(100, seed=6)
    model = LinkModel.learn(evidence, linked, learned_from={"source": "a test"}, features=AHEAD)
    path = tmp_path / "model.json"
    model.save(path)
    again = LinkModel.load(path)
    assert (again.weights == model.weights).all()
    assert (again.bias, again.prior) == (model.bias, model.prior)
    assert again.learned_from == model.learned_from and again.features == AHEAD

    def spoiled(**changes: object) -> Path:
        content = json.loads(path.read_text()) | changes
        (tmp_path / "spoiled.json").write_text(json.dumps(content))
        return tmp_path / "spoiled.json"

    for changes, message in (
        ({"bias": 0.0}, "checksum does not match"),
        ({"format": "a diary"}, "not a pflut link model"),
        ({"version": 2}, "link model version 2, expected 1"),
        ({"features": ["luck"]}, "learn it again or upgrade"),
        ({"features": [["spread"]]}, "learn it again or upgrade"),
        ({"features": list(ALL_AROUND)}, "checksum does not match"),
    ):
        with pytest.raises(ValueError, match=message):
            LinkModel.load(spoiled(**changes))
    (tmp_path / "short.json").write_text(path.read_text()[:50])
    with pytest.raises(ValueError, match="not a JSON file"):
        LinkModel.load(tmp_path / "short.json")
    with pytest.raises(FileNotFoundError):
        LinkModel.load(tmp_path / "missing.json")


def test_models_are_checked() -> None:
    evidence = some_evidence([1.0, 2.0], [3, 4])
    with pytest.raises(ValueError, match="weights: expected 3 finite numbers"):
        LinkModel([1.0], 0.0, 0.5)
    with pytest.raises(ValueError, match="weights: expected 6 finite numbers"):
        LinkModel([1.0, 1.0, 1.0], 0.0, 0.5, features=AHEAD)
    with pytest.raises(ValueError, match=r"features: expected some of .*, got \['luck'\]"):
        LinkModel([1.0], 0.0, 0.5, features=("luck",))
    with pytest.raises(ValueError, match="features: expected some of"):
        LinkModel.learn(evidence, [True, False], features=["luck"])
    with pytest.raises(ValueError, match="bias"):
        LinkModel([1.0, 1.0, 1.0], np.inf, 0.5)
    for prior in (0.0, 1.0, np.nan):
        with pytest.raises(ValueError, match=r"prior: expected a share in \(0, 1\)"):
            LinkModel([1.0, 1.0, 1.0], 0.0, 0.5).probability(evidence, prior=prior)
    with pytest.raises(ValueError, match=r"linked, weights: expected shape \(2,\)"):
        LinkModel.learn(evidence, [True])
    with pytest.raises(ValueError, match="linked: expected pairs that are, and pairs that are not"):
        LinkModel.learn(evidence, [True, True])
    with pytest.raises(ValueError, match="weights: expected finite numbers"):
        LinkModel.learn(evidence, [True, False], weights=[1.0, -1.0])
