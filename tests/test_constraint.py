"""Constraints: what posteriors are called, and the rotation they give."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.geometry import TWO_PI, rotation_from_headings, wrap_to_pi
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.constraint import (
    COMPONENTS_OF_NONE,
    PoseConstraint,
    arcs,
    classify,
    extract_constraint,
)
from pflut.posterior import GridPosterior, pose_posterior
from pflut.simulation.correspondences import CorrespondenceSimulator
from pflut.von_mises.mixture import LOG_UNIFORM, VonMisesMixture


def modes(*means: tuple[float, float], weight: float = 1.0, k: float = 200.0) -> VonMisesMixture:
    n = len(means)
    return VonMisesMixture(
        weights=np.full(n, weight / n),
        means=means,
        concentrations=np.full((n, 2), k),
        couplings=np.zeros(n),
        uniform_weight=1.0 - weight,
    )


def band(weight: float, heading_concentration: float = 0.0) -> VonMisesMixture:
    return VonMisesMixture(
        rotation_weights=[weight],
        rotation_means=[1.0],
        rotation_concentrations=[600.0],
        uniform_weight=1.0 - weight,
        rotation_heading_concentrations=[heading_concentration],
    )


def posterior_of(mixture: VonMisesMixture, bins: int = 128) -> GridPosterior:
    with np.errstate(divide="ignore"):
        return GridPosterior(np.log(mixture.cell_probabilities(bins)), 0.0)


@pytest.mark.parametrize(
    ("kind", "mixture"),
    [
        ("pose", modes((1.0, 2.0))),
        ("pose", modes((1.0, 2.0), weight=0.9)),
        # two places whose rotations differ
        ("pose", modes((1.0, 2.0), (4.0, 0.5), k=2000.0)),
        # the opposite direction has the same rotation
        ("headings", modes((1.0, 2.0), (1.0 + np.pi, 2.0 + np.pi))),
        ("headings", modes((0.0, 1.0), (1.5, 2.5), weight=0.9)),
        ("rotation", band(1.0)),
        ("rotation", band(0.85)),
        ("rotation", band(1.0, 2.0)),
        # a band around a fifth of the circle is a pose
        ("pose", band(1.0, 40.0)),
        ("none", modes((1.0, 2.0), weight=0.3)),
        ("none", modes((1.0, 2.0), k=2.0)),
        ("none", VonMisesMixture(uniform_weight=1.0)),
    ],
)
def test_kinds(kind: str, mixture: VonMisesMixture) -> None:
    constraint = extract_constraint(posterior_of(mixture))
    assert constraint.kind == kind
    assert 0.0 <= constraint.divergence < 0.1
    assert constraint.entropy == pytest.approx(mixture.entropy(), abs=0.1)
    if kind == "none":
        assert constraint.mixture.num_components <= COMPONENTS_OF_NONE


def test_kind_does_not_depend_on_where_zero_is() -> None:
    two = posterior_of(modes((1.0, 2.0), (1.0 + np.pi, 2.0 + np.pi)))
    turned = posterior_of(band(1.0))
    for shift in range(0, 128, 9):
        for posterior, kind in ((two, "headings"), (turned, "rotation")):
            rolled = np.roll(posterior.log_prob, (shift, 3 * shift), (0, 1))
            assert classify(GridPosterior(rolled, 0.0)) == kind


def test_arcs() -> None:
    marginal = np.zeros(36)
    marginal[[35, 0, 1]] = 0.2
    marginal[[10, 11]] = 0.15
    marginal[20] = 0.1
    width, masses = arcs(marginal, 0.9)
    assert width == pytest.approx(5 * TWO_PI / 36)
    assert masses == pytest.approx([0.6, 0.3])
    width, masses = arcs(marginal, 1.0)
    assert masses == pytest.approx([0.6, 0.3, 0.1])
    # a gap of one bin, ten degrees, does not part them
    marginal = np.zeros(36)
    marginal[[4, 6, 20]] = [0.4, 0.3, 0.3]
    assert arcs(marginal, 1.0)[1] == pytest.approx([0.7, 0.3])
    assert arcs(np.full(36, 1 / 36), 1.0)[1] == pytest.approx([1.0])


def test_rotation_of_a_constraint() -> None:
    constraint = extract_constraint(posterior_of(band(0.9)))
    rotation = constraint.rotation()
    assert rotation.mean == pytest.approx(1.0, abs=0.01)
    assert rotation.concentration == pytest.approx(600.0, rel=0.2)
    known = extract_constraint(posterior_of(modes((1.0, 2.0)))).rotation()
    assert known.mean == pytest.approx(rotation_from_headings(1.0, 2.0), abs=0.01)
    assert known.concentration == pytest.approx(100.0, rel=0.1)
    unknown = PoseConstraint("none", VonMisesMixture(uniform_weight=1.0), -LOG_UNIFORM, 0.0)
    assert unknown.rotation().concentration == 0.0
    assert unknown.log_density([0.0, 0.0]) == pytest.approx(LOG_UNIFORM)


def test_simulated_pairs_are_poses(default_table: LikelihoodTable) -> None:
    pairs, headings = CorrespondenceSimulator(mismatch=0.5).pairs(20, 50, rng=2)
    for correspondences, truth in zip(pairs, headings, strict=True):
        posterior = pose_posterior(correspondences, default_table, temperature=0.5)
        constraint = extract_constraint(posterior)
        assert constraint.kind == "pose"
        error = wrap_to_pi(np.array(constraint.mixture.mode()) - truth)
        # nowhere near as improbable as nothing known
        assert constraint.log_density(truth) > LOG_UNIFORM + 2.0
        assert np.abs(error).max() < 0.1


def test_mismatches_alone_constrain_nothing(default_table: LikelihoodTable) -> None:
    pairs, _ = CorrespondenceSimulator(mismatch=1.0).pairs(20, 25, rng=3)
    kinds = [classify(pose_posterior(c, default_table, temperature=0.3)) for c in pairs]
    assert kinds == ["none"] * 20


def test_refuses() -> None:
    with pytest.raises(ValueError, match="kind: expected one of"):
        PoseConstraint("loop", VonMisesMixture(uniform_weight=1.0), 0.0, 0.0)
    with pytest.raises(ValueError, match="max_components: expected"):
        extract_constraint(posterior_of(band(1.0), 32), max_components=0)
