"""Estimators beside each other: the clock, one's own, the best of a family, misuse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest

from pflut.comparison import (
    PAPER_RANSAC,
    RANSACS,
    Headings,
    best_estimator,
    by_maximum,
    by_ransac,
    by_table,
    compare_estimators,
)
from pflut.correspondences import Correspondences
from pflut.likelihood.dense import DenseTable
from pflut.likelihood.table import LikelihoodTable
from pflut.simulation.correspondences import CorrespondenceSimulator

PAIRS = 30


@pytest.fixture(scope="module")
def simulated() -> tuple[list[Correspondences], np.ndarray]:
    headings, bearings = CorrespondenceSimulator(mismatch=0.4).sample(PAIRS, 60, rng=1)
    return [Correspondences(*pair.T) for pair in bearings], headings


def test_all_kinds_of_estimators_are_compared_on_the_same_pairs(
    simulated, default_table: LikelihoodTable, dense_table: DenseTable
) -> None:
    pairs, headings = simulated
    done: list[str] = []

    def guess(some: Sequence[Correspondences]) -> list[SimpleNamespace]:
        return [SimpleNamespace(heading_l=0.0, heading_r=np.nan) for _ in some]

    estimators = {
        "table": by_table(default_table),
        "dense": by_table(dense_table),
        "paper's dense": by_table(dense_table, polish=False),
        "2pt": by_ransac(),
        "paper's 3pt": by_ransac(solver="3pt", **PAPER_RANSAC),
        "guess": guess,
    }
    compared = compare_estimators(estimators, pairs, headings, progress=done.append)
    assert list(compared) == done == list(estimators)
    for name, errors in compared.items():
        assert errors.heading.shape == errors.rotation.shape == (PAIRS,)
        assert errors.seconds >= 0.0
        assert errors.found.mean() == 0.0 if name == "guess" else errors.found.mean() > 0.8
    # cells are as wide as the errors are, until they are polished
    medians = {name: np.median(errors.heading) for name, errors in compared.items()}
    assert medians["paper's dense"] > 1.5 * medians["dense"]


def test_the_clock_counts_the_pairs_alone(simulated) -> None:
    """Neither the first call, in which kernels are compiled, nor waiting."""
    pairs, headings = simulated
    calls: list[int] = []

    def busy(some: Sequence[Correspondences]) -> list[SimpleNamespace]:
        calls.append(len(some))
        until = process_time() + (0.3 if len(calls) == 1 else 0.06)
        while process_time() < until:
            pass
        return [SimpleNamespace(heading_l=0.0, heading_r=0.0) for _ in some]

    errors = compare_estimators({"busy": busy}, pairs, headings)["busy"]
    assert calls == [2, PAIRS]
    assert 0.06 <= PAIRS * errors.seconds < 0.2


def test_finding_nothing_is_no_answer() -> None:
    """Zeros that a RANSAC gives then would be right where the truth is near zero."""
    horizon = Correspondences([0.1, 0.9, 2.0], np.zeros(3), [1.1, 1.9, 4.0], np.zeros(3))
    pairs = [Correspondences.empty(), horizon]
    errors = compare_estimators({"2pt": by_ransac()}, pairs, [[0.0, 0.05]] * 2)["2pt"]
    assert not errors.found.any()
    assert (errors.heading == np.pi).all()
    assert (errors.rotation == np.pi).all()


def test_the_maximum_is_the_highest_cell_s_centre(dense_table: DenseTable, simulated) -> None:
    pairs, headings = simulated
    found = by_maximum(dense_table)(pairs)
    for pose, pair in zip(found, pairs, strict=True):
        cell = np.unravel_index(
            dense_table.log_likelihood_grid(pair).argmax(), (dense_table.bins,) * 2
        )
        expected = (np.array(cell) + 0.5) * 2 * np.pi / dense_table.bins
        assert tuple(pose) == pytest.approx(expected)
    assert (
        compare_estimators({"a": by_maximum(dense_table)}, pairs, headings)["a"].found.mean() > 0.8
    )


def test_the_best_of_a_family_has_the_least_median_error(simulated) -> None:
    pairs, headings = simulated

    def off_by(angle: float) -> Callable[[Sequence[Correspondences]], list[Headings]]:
        """Be wrong by so much, and once by far."""
        known = {id(pair): pose for pair, pose in zip(pairs, headings, strict=True)}

        def estimate(some: Sequence[Correspondences]) -> list[Headings]:
            found = [Headings(known[id(pair)][0] + angle, 0.0) for pair in some]
            return [Headings(), *found[1:]]

        return estimate

    family = {angle: off_by(angle) for angle in (0.3, -0.1, 0.2, 0.1)}
    assert best_estimator(family, pairs, headings) == -0.1
    noises = {noise: by_ransac(noise=noise) for noise in (0.0002, 0.01, 0.2)}
    assert best_estimator(noises, pairs, headings) == 0.01
    for some, few in ((family, 0), ({}, 3)):
        with pytest.raises(ValueError, match="at least one estimator and one pair"):
            best_estimator(some, pairs[:few], headings[:few])


def test_named_ransacs_have_the_options_they_are_named_for(simulated) -> None:
    pairs, headings = simulated
    compared = compare_estimators(
        {name: by_ransac(**options) for name, options in RANSACS.items()}, pairs, headings
    )
    found = {name: errors.found.mean() for name, errors in compared.items()}
    assert min(found["3-point RANSAC"], found["2-point LO-RANSAC"]) > 0.8
    assert found["8-point RANSAC"] < found["2-point RANSAC"]
    assert RANSACS["2-point RANSAC"] == {"solver": "2pt", **PAPER_RANSAC}


def test_misuse(simulated) -> None:
    pairs, headings = simulated
    with pytest.raises(ValueError, match=r"headings: expected shape \(30, 2\), got \(29, 2\)"):
        compare_estimators({"2pt": by_ransac()}, pairs, headings[1:])
    with pytest.raises(ValueError, match="headings: expected finite radians"):
        compare_estimators({"2pt": by_ransac()}, pairs[:1], [[0.0, np.nan]])
    with pytest.raises(ValueError, match="mine: expected 30 poses, one a pair, got 1"):
        compare_estimators({"mine": lambda some: [Headings(0.0, 0.0)]}, pairs, headings)
    with pytest.raises(ValueError, match="solver: expected one of"):
        compare_estimators({"2pt": by_ransac(solver="5pt")}, pairs, headings)
