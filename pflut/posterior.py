"""The posterior over the relative poses of two views, on a grid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences
from pflut.geometry import TWO_PI, FloatArray, circular_mean, wrap_to_pi
from pflut.von_mises.mixture import MAX_COMPONENTS, VonMisesMixture


class Likelihood(Protocol):
    """What a posterior needs of a table of likelihoods."""

    @property
    def bins(self) -> int:
        """Cells of the headings' axes."""
        ...

    def log_likelihood_grid(
        self,
        correspondences: Correspondences,
        bins: int | None = None,
        *,
        window: NDArray[np.int64] | None = None,
    ) -> NDArray[np.float32]:
        """Sum log-likelihood ratios over a (bins, bins) grid of (heading_l, heading_r).

        Finite numbers. Cells outside the ``window`` (2, 2), the first cell and how many of either
        heading, may hold anything: it is there to save time, and may be ignored.
        """
        ...


@dataclass(frozen=True, eq=False)
class GridPosterior:
    """Probabilities of relative poses (heading_l, heading_r), both over [0, 2 pi).

    Parameters
    ----------
    log_prob : ndarray of shape (B, B)
        Log of the probability of each cell; their exponentials sum to one. Cell (i, j) is centred
        on ((i + 1/2) 2 pi / B, (j + 1/2) 2 pi / B).
    log_evidence : float
        Log of the probability of the correspondences given that the views are linked by one of
        the poses, over that given that every azimuth is uniform. Large: they show one scene.
    """

    log_prob: FloatArray
    log_evidence: float

    @property
    def bins(self) -> int:
        """Cells of an axis."""
        return int(self.log_prob.shape[0])

    @property
    def centers(self) -> FloatArray:
        """The cells' centres, radians, of shape (B,)."""
        return np.asarray((np.arange(self.bins) + 0.5) * (TWO_PI / self.bins))

    @cached_property
    def prob(self) -> FloatArray:
        """The cells' probabilities, of shape (B, B)."""
        return np.exp(self.log_prob)

    def mode(self) -> tuple[float, float]:
        """Return the maximum, interpolated between the cells.

        A parabola is laid through the highest cell and its two neighbours along each axis.

        Returns
        -------
        heading_l, heading_r : float
            Radians in (-pi, pi].
        """
        bins = self.bins
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(self.log_prob)), (bins, bins)))

        def offset(before: float, here: float, after: float) -> float:
            curvature = 2.0 * here - before - after
            if not 0.0 < curvature < np.inf:  # a plateau, or a neighbour that is impossible
                return 0.0
            return 0.5 * (after - before) / curvature

        log_prob = self.log_prob
        d_l = offset(log_prob[i - 1, j], log_prob[i, j], log_prob[(i + 1) % bins, j])
        d_r = offset(log_prob[i, j - 1], log_prob[i, j], log_prob[i, (j + 1) % bins])
        cell = TWO_PI / bins
        return (
            float(wrap_to_pi((i + 0.5 + d_l) * cell)),
            float(wrap_to_pi((j + 0.5 + d_r) * cell)),
        )

    def heading_l(self) -> FloatArray:
        """Return the marginal of heading_l: probabilities of shape (B,) at `centers`."""
        return np.asarray(self.prob.sum(axis=1))

    def heading_r(self) -> FloatArray:
        """Return the marginal of heading_r: probabilities of shape (B,) at `centers`."""
        return np.asarray(self.prob.sum(axis=0))

    def rotation(self) -> tuple[FloatArray, FloatArray]:
        """Return the marginal of the rotation psi = heading_l - heading_r + pi.

        On a turn on the spot the headings are unknown but the rotation is not: the posterior is a
        diagonal band (Figure 8 of the paper), and this marginal is narrow.

        Returns
        -------
        angles : ndarray of shape (B,)
            Radians in (-pi, pi], ascending.
        probabilities : ndarray of shape (B,)
            They sum to one.
        """
        angles = wrap_to_pi(np.arange(self.bins) * (TWO_PI / self.bins) + np.pi)
        order = np.argsort(angles)
        return angles[order], diagonals(self.prob).sum(axis=1)[order]

    def rotation_mean(self) -> float:
        """Return the circular mean of the rotation, radians in (-pi, pi]."""
        return circular_mean(*self.rotation())

    def cell(self, heading_l: float, heading_r: float) -> tuple[int, int]:
        """Return the indices of the cell that a pose lies in.

        Parameters
        ----------
        heading_l, heading_r : float
            Radians, any number of turns.

        Returns
        -------
        i, j : int
            Of heading_l and of heading_r.
        """
        i, j = np.floor(np.array([heading_l, heading_r]) * (self.bins / TWO_PI)).astype(int)
        return int(i) % self.bins, int(j) % self.bins

    def log_density(self, heading_l: float, heading_r: float) -> float:
        """Return the log of the probability density at a pose.

        The true pose's is a proper score of a posterior: in the mean over many pairs the right
        posterior has the highest. Where nothing is known it is -2 log(2 pi) = -3.68.

        Parameters
        ----------
        heading_l, heading_r : float
            Radians.

        Returns
        -------
        float
            Of probability a squared radian, in nats; grids of any number of cells compare.
        """
        area = (TWO_PI / self.bins) ** 2
        return float(self.log_prob[self.cell(heading_l, heading_r)] - np.log(area))

    def credible_mass(self, heading_l: float, heading_r: float) -> float:
        """Return the mass of the smallest credible region that contains a pose.

        If the posteriors are calibrated, the true pose's value is uniform over [0, 1]: a share p
        of the true poses lies in the regions of mass p.

        Parameters
        ----------
        heading_l, heading_r : float
            Radians.

        Returns
        -------
        float
            The probability of all cells at least as probable as the pose's own; of cells as
            probable as it, half.
        """
        level = self.log_prob[self.cell(heading_l, heading_r)]
        above = float(self.prob[self.log_prob > level].sum())
        equal = float(self.prob[self.log_prob == level].sum())
        return min(1.0, above + 0.5 * equal)

    def credible_region(self, mass: float) -> NDArray[np.bool_]:
        """Return the smallest set of cells that holds a mass.

        Parameters
        ----------
        mass : float
            In (0, 1].

        Returns
        -------
        ndarray of shape (B, B), bool

        Raises
        ------
        ValueError
            If the mass is out of its range.
        """
        if not 0.0 < mass <= 1.0:
            raise ValueError(f"mass: expected a number in (0, 1], got {mass}")
        flat = self.prob.ravel()
        order = np.argsort(-flat, kind="stable")
        needed = int(np.searchsorted(np.cumsum(flat[order]), mass)) + 1
        region = np.zeros(flat.size, np.bool_)
        region[order[:needed]] = True
        return region.reshape(self.prob.shape)

    def entropy(self) -> float:
        """Return the entropy in nats; log(B^2) where nothing is known."""
        possible = self.prob > 0.0
        return float(-np.sum(self.prob[possible] * self.log_prob[possible]))

    def von_mises_mixture(self, *, max_components: int = MAX_COMPONENTS) -> VonMisesMixture:
        """Return a mixture of von Mises distributions with nearly the same probabilities.

        Parameters
        ----------
        max_components : int
            Modes and bands at most.

        Returns
        -------
        VonMisesMixture
            Its `divergence` says how near; see `pflut.von_mises.fit.fit_mixture` for how many
            components it has.

        Raises
        ------
        ValueError
            If the number is not positive.
        """
        # the fit brings Numba with it
        from pflut.von_mises.fit import fit_mixture

        return fit_mixture(self.log_prob, self.prob, max_components=max_components)[0]


def pose_posterior(
    correspondences: Correspondences,
    likelihood: Likelihood,
    *,
    bins: int | None = None,
    temperature: float = 1.0,
) -> GridPosterior:
    """Compute the posterior of the relative pose, all poses being as probable beforehand.

    Parameters
    ----------
    correspondences : Correspondences
        Between the reference view L and the query view R. With none, all poses stay as probable.
    likelihood : LikelihoodTable or DenseTable
    bins : int, optional
        Cells an axis. Default: the table's own; the paper's table has no others.
    temperature : float
        Factor on the log-likelihood in (0, 1]; below one it answers for correspondences that are
        not independent.

    Returns
    -------
    GridPosterior

    Raises
    ------
    ValueError
        If a parameter is out of its range.
    """
    check_temperature(temperature)
    grid = temperature * likelihood.log_likelihood_grid(correspondences, bins).astype(np.float64)
    peak = float(grid.max())
    log_sum = peak + float(np.log(np.exp(grid - peak).sum()))
    return GridPosterior(grid - log_sum, log_sum - 2.0 * float(np.log(len(grid))))


def diagonals(grid: NDArray[np.floating]) -> NDArray[np.floating]:
    """Sort the cells of a periodic grid over (heading_l, heading_r) by rotation.

    Parameters
    ----------
    grid : ndarray of shape (B, B)

    Returns
    -------
    ndarray of shape (B, B)
        Row k holds the cells of heading_l - heading_r = k cells, by heading_r; read-only.
    """
    twice = np.tile(grid, (2, 1))
    row, cell = twice.strides
    return np.lib.stride_tricks.as_strided(twice, grid.shape, (row, row + cell), writeable=False)


def check_temperature(temperature: float) -> None:
    """Raise ValueError if a temperature is not in (0, 1]."""
    if not 0.0 < temperature <= 1.0:
        raise ValueError(f"temperature: expected a number in (0, 1], got {temperature}")
