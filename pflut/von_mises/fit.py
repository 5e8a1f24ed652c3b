"""Fitting a mixture to the probabilities of a grid."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import TWO_PI, FloatArray
from pflut.von_mises import _components as columns
from pflut.von_mises.expectation_kernels import cross_entropy, expect
from pflut.von_mises.maximization_kernels import maximize
from pflut.von_mises.mixture import MAX_COMPONENTS, VonMisesMixture
from pflut.von_mises.point_kernels import BLOCK, CHUNK, LEVELS, TILES, make_points
from pflut.von_mises.seed_kernels import add_modes, find_band

TARGET = 0.045
"""Nats of divergence at which nothing is added any more."""
LEAST_GAIN = 0.0003
"""Nats by which a component must lower the divergence."""
ADDED = 4
"""Modes are added so many at once, or as many as there are."""
WORTH = 0.0005
"""Nats that a tile of the torus must lack for a mode to be added there."""
NEARBY, CLOSE = 0.25, 2.5
"""Radians within which what is missing makes one new mode; cells, where that has not helped."""
FRESH_STEPS, STEPS = 2, 3
"""Of expectation maximization: of new modes by themselves, then of all."""
POLISHES = 4
"""So many times so many steps at most, once nothing is added any more."""
LEAST_WEIGHT = 1e-4
"""Components with less are left out in the end."""


def fit_mixture(
    log_prob: FloatArray, prob: FloatArray, *, max_components: int = MAX_COMPONENTS
) -> tuple[VonMisesMixture, float]:
    """Fit a mixture to a grid of probabilities by expectation maximization.

    Parameters
    ----------
    log_prob, prob : ndarray of shape (B, B)
        Of cells centred on ((i + 1/2) 2 pi / B, (j + 1/2) 2 pi / B); the sum of ``prob`` is one.
    max_components : int
        Modes and bands at most; positive.

    Returns
    -------
    mixture : VonMisesMixture
    divergence : float
        Kullback-Leibler divergence of the grid from the mixture's `cell_probabilities`, nats, to
        some thousandths.

    Raises
    ------
    ValueError
        If the number is not positive, or a shape is not square.

    Notes
    -----
    **How many components?** It starts with the uniform density, and a band if one rotation holds
    much. Then, until the divergence falls to 0.045 nats, modes are added where the mixture lacks
    most, improved by two steps alone and by three with all others. It stops early when twice in a
    row a new component has gained less than 0.0003 nats. Criteria such as BIC weigh the number of
    samples, and a grid has none. Most posteriors need one component; what many crossing ridges are
    needs more than a map can use, and there the limit decides.

    A step goes on by half of what expectation maximization gives: R. Salakhutdinov, S. Roweis,
    "Adaptive overrelaxed bound optimization methods", ICML 2003.
    """
    if max_components < 1:
        raise ValueError(f"max_components: expected a positive number, got {max_components}")
    bins = len(prob)
    if log_prob.shape != (bins, bins) or prob.shape != (bins, bins):
        raise ValueError(
            f"log_prob, prob: expected shape (B, B), got {log_prob.shape}, {prob.shape}"
        )
    growing = _GrowingMixture(log_prob, prob, max_components)
    divergence = growing.divergence()
    disappointed = False
    while divergence > TARGET and growing.count < max_components:
        # two narrow modes in one place are seen as one, unless looked at closely
        added = growing.add(CLOSE * TWO_PI / bins if disappointed else NEARBY)
        if added == 0:
            break
        growing.improve(FRESH_STEPS, first=growing.count - added)
        growing.improve(STEPS)
        before, divergence = divergence, growing.divergence()
        # modes that are nearly one need a second round to part
        little = before - divergence < LEAST_GAIN * added
        if little and disappointed:
            break
        disappointed = little
    # nothing more may be added: improve what there is
    for _ in range(POLISHES):
        if divergence <= TARGET:
            break
        growing.improve(POLISHES)
        before, divergence = divergence, growing.divergence()
        if before - divergence < 0.05 * divergence:
            break
    return _mixture(growing.components[: growing.count], growing.uniform), divergence


class _GrowingMixture:
    """A mixture, and the arrays of the kernels that fit it to a grid.

    ``components`` (limit, columns), of which there are ``count``; ``uniform``: the weight of the
    rest.
    """

    def __init__(self, log_prob: FloatArray, prob: FloatArray, limit: int) -> None:
        # arrays that must not be written are another type to Numba
        log_prob = np.require(log_prob, np.float64, ["C", "W"])
        prob = np.require(prob, np.float64, ["C", "W"])
        bins = len(prob)
        size = bins * bins + LEVELS * CHUNK
        self.points = np.empty((5, size), dtype=np.float32)
        self.chunks = np.empty((6, size // CHUNK), dtype=np.float32)
        self.start = np.empty((LEVELS, TILES**2 + 1), dtype=np.int64)
        kinds, diagonals = np.empty((bins, bins), dtype=np.int8), np.empty(bins)
        information, self.blocks, number = make_points(
            log_prob, prob, _axes(bins), kinds, diagonals, self.points, self.start, self.chunks
        )
        self.cell = TWO_PI / bins
        self.information = information - 2.0 * float(np.log(self.cell))
        size = number * CHUNK
        self.reach = np.empty(number, dtype=np.float32)
        self.runs = np.empty((limit, number // 2 + 1, 2), dtype=np.uint64)
        self.num_runs = np.empty(limit, dtype=np.int64)
        self.scratch = np.empty((limit, size), dtype=np.float32)
        self.total = np.empty(size, dtype=np.float32)
        self.gains = np.empty(2 * TILES**2, dtype=np.float32)
        self.best = np.empty(TILES**2, dtype=np.int64)
        self.components = np.zeros((limit, columns.COLUMNS))
        self.count = int(find_band(prob, diagonals, self.components[0]))
        self.uniform = 1.0 - float(self.components[0, columns.WEIGHT])
        self._expect(0)

    def divergence(self) -> float:
        """Give the divergence of the grid from the mixture, nats."""
        return float(self.information + cross_entropy(self.points, self.total))

    def add(self, nearby: float) -> int:
        """Add modes where most is missing, what is nearby in one; return how many."""
        room = min(max(ADDED, self.count), len(self.components) - self.count)
        added = add_modes(
            self.points,
            self.start,
            self.cell,
            self.total,
            nearby,
            self.components,
            self.count,
            room,
            WORTH,
            self.gains,
            self.best,
        )
        self.count += added
        self._expect(self.count - added)
        return int(added)

    def improve(self, steps: int, first: int = 0) -> None:
        """Take steps of expectation maximization, with the components from a first one on.

        After modes were added all weigh more than one, until all have had a step.
        """
        for _ in range(steps):
            rest = maximize(
                self.points,
                self.blocks,
                self.cell,
                self.components[: self.count],
                first,
                self.runs,
                self.num_runs,
                self.scratch,
                self.total,
            )
            if first == 0:
                self.uniform = float(rest)
            self._expect(first)

    def _expect(self, first: int) -> None:
        """Evaluate the mixture, after components from a first one on have changed."""
        expect(
            self.points,
            self.chunks,
            self.blocks,
            self.cell,
            self.components[: self.count],
            first,
            self.uniform,
            self.reach,
            self.runs,
            self.num_runs,
            self.scratch,
            self.total,
        )


def _mixture(components: FloatArray, uniform: float) -> VonMisesMixture:
    """Make a mixture of the kernels' rows."""
    weight = components[:, columns.WEIGHT]
    kept = components[weight > LEAST_WEIGHT]
    kept[:, columns.WEIGHT] /= kept[:, columns.WEIGHT].sum() + uniform
    band = kept[:, columns.KIND] == columns.BAND
    modes, bands = kept[~band], kept[band]
    means = [columns.MEAN_1, columns.MEAN_2]
    concentrations = [columns.K_1, columns.K_2]
    return VonMisesMixture(
        weights=modes[:, columns.WEIGHT],
        means=modes[:, means],
        concentrations=modes[:, concentrations],
        couplings=modes[:, columns.COUPLING],
        rotation_weights=bands[:, columns.WEIGHT],
        rotation_means=bands[:, columns.MEAN_1],
        rotation_concentrations=bands[:, columns.K_1],
        uniform_weight=max(1.0 - float(kept[:, columns.WEIGHT].sum()), 0.0),
        rotation_headings=bands[:, columns.MEAN_2],
        rotation_heading_concentrations=bands[:, columns.K_2],
    )


@lru_cache(maxsize=8)
def _axes(bins: int) -> NDArray[np.float32]:
    """Give the sines and cosines of the places of blocks and cells."""
    axes = np.zeros((LEVELS, 2, bins), dtype=np.float32)
    for level, number in enumerate((bins // BLOCK, bins)):
        places = (np.arange(number) + 0.5) * (TWO_PI / max(number, 1))
        axes[level, :, :number] = np.sin(places), np.cos(places)
    return axes
