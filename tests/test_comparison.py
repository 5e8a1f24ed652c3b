"""Estimators beside each other: errors, the clock, one's own, misuse."""

from __future__ import annotations

from collections.abc import Sequence
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest

from pflut.comparison import (
    MAX_HEADING_ERROR,
    PAPER_RANSAC,
    Headings,
    PairErrors,
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


def test_errors_are_those_of_the_angles() -> None:
    truth = np.array([[0.1, 3.1], [1.0, 2.0], [0.0, 0.0]])
    found = np.array([[-0.1, -3.1], [1.05, 2.05], [np.nan, 0.0]])
    errors = PairErrors.of([Headings(*row) for row in found], truth, 0.5)
    assert errors.heading_l == pytest.approx([0.2, 0.05, np.pi])
    assert errors.heading_r[:2] == pytest.approx([2 * np.pi - 6.2, 0.05])
    # psi = theta - phi + pi
    assert errors.rotation == pytest.approx([0.2 + 2 * np.pi - 6.2, 0.0, np.pi], abs=1e-12)
    assert errors.heading == pytest.approx([0.2, 0.05, np.pi])
    assert errors.found.tolist() == [False, True, False]
    assert MAX_HEADING_ERROR == 0.1
    assert errors.seconds == 0.5
    # some of the pairs, and several sets together: the mean pair's time
    some = errors[errors.found]
    assert (len(some), some.rotation.tolist()) == (1, errors.rotation[1:2].tolist())
    other = PairErrors.of([Headings(0.0, 0.0)], [[0.0, 0.3]], 0.9)
    both = PairErrors.together([errors, other])
    assert len(both) == 4
    assert both.heading_r.tolist() == [*errors.heading_r, *other.heading_r]
    assert both[:3].heading_l.tolist() == errors.heading_l.tolist()
    assert both.seconds == pytest.approx(0.6)


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
