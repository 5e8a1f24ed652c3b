"""The paper's look-up table of likelihoods: the baseline."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pflut._cache import cache_dir
from pflut.correspondences import Correspondences
from pflut.likelihood.dense_kernels import ROWS, add_slices, discretize
from pflut.likelihood.dense_learning import (
    count_pairs,
    count_simulated,
    log_ratio_from_counts,
)
from pflut.likelihood.known_pairs import Pair
from pflut.likelihood.sampling import Progress
from pflut.likelihood.storage import read_table, write_table
from pflut.simulation.correspondences import CorrespondenceSimulator

KIND = "dense"
DEFAULT_BINS = 128
DEFAULT_SAMPLES = 64_000_000
EMPTY_CELL_SHARE = 1e-3
LEARNING_VERSION = 1
"""Goes up when simulator, cells or mixing change: tables in caches are then learned anew."""
MIN_BINS, MAX_BINS = 4, 512


@dataclasses.dataclass(frozen=True, eq=False)
class DenseTable:
    """Log-likelihood ratios of a correspondence over (r, u, v).

    One value is log p(u, v | r) minus that of uniform u and v, with u = theta - alpha_l,
    v = phi - alpha_r and r = tan(elevation_r) / tan(elevation_l), |r| <= 1; where |r| > 1 the
    views are exchanged. Zero says nothing about the pose.

    Parameters
    ----------
    log_ratio : ndarray of shape (R, B, B), float32
        R cells of r over [-1, 1], B cells of u and of v over [0, 2 pi).
    learned_from : dict
        How the table was learned; stored in its file.

    Raises
    ------
    ValueError
        If the shape is another or a value is not finite.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010, section III.
    """

    log_ratio: NDArray[np.float32]
    learned_from: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        table = np.ascontiguousarray(self.log_ratio, dtype=np.float32)
        if table.ndim != 3 or table.shape[1] != table.shape[2] or table.size == 0:
            raise ValueError(f"log_ratio: expected shape (R, B, B), got {table.shape}")
        if not np.isfinite(table).all():
            raise ValueError("log_ratio: holds values that are not finite")
        object.__setattr__(self, "log_ratio", table)

    @property
    def bins(self) -> int:
        """Cells of the headings' axes."""
        return int(self.log_ratio.shape[1])

    @cached_property
    def _slices(self) -> NDArray[np.float32]:
        """The table and its transpose over (u, v), so that exchanged views read rows too."""
        return np.ascontiguousarray(np.stack([self.log_ratio, self.log_ratio.transpose(0, 2, 1)]))

    def log_likelihood_grid(
        self,
        correspondences: Correspondences,
        bins: int | None = None,
        *,
        window: NDArray[np.int64] | None = None,
    ) -> NDArray[np.float32]:
        """Sum the correspondences' log-likelihood ratios over the grid of poses (Algorithm 1).

        Parameters
        ----------
        correspondences : Correspondences
        bins : int, optional
            Cells an axis, which must be the table's own.
        window : ndarray of shape (2, 2), int64, optional
            See `LikelihoodTable.log_likelihood_grid`; all cells are computed anyway.

        Returns
        -------
        ndarray of shape (B, B), float32
            Over (heading_l, heading_r); the cell (i, j) is centred on
            ((i + 1/2) 2 pi / B, (j + 1/2) 2 pi / B). Zero everywhere without correspondences.

        Raises
        ------
        ValueError
            If other bins are asked for.
        """
        if bins is not None and bins != self.bins:
            raise ValueError(
                f"bins: this table has {self.bins}, got {bins}; "
                f"learn another with DenseTable.from_simulation(bins={bins})"
            )
        cells = np.empty((len(correspondences), 4), np.int64)
        discretize(
            correspondences.azimuth_l,
            correspondences.elevation_l,
            correspondences.azimuth_r,
            correspondences.elevation_r,
            self.bins,
            self.log_ratio.shape[0],
            cells,
        )
        grid = np.empty((self.bins, self.bins), np.float32)
        wide = np.empty((ROWS, 2 * self.bins), np.float32)
        add_slices(self._slices, cells, wide, grid)
        return grid

    @classmethod
    def from_simulation(
        cls,
        *,
        bins: int = DEFAULT_BINS,
        num_samples: int = DEFAULT_SAMPLES,
        simulator: CorrespondenceSimulator | None = None,
        mismatches: Literal["uniform", "simulated"] = "uniform",
        seed: int = 0,
        num_threads: int | None = None,
        progress: Progress | None = None,
    ) -> DenseTable:
        """Learn a table from the simulator.

        Parameters
        ----------
        bins : int
            Cells of every axis, 4 to 512. The paper has 16, 32, 64, 128.
        num_samples : int
            Simulated correspondences.
        simulator : CorrespondenceSimulator, optional
            Noise, tilt and mismatch share; default the paper's, with 90 % mismatches.
        mismatches : {"uniform", "simulated"}
            How the mismatches' share enters. "simulated" is the paper's: mismatches are
            simulated like the rest. They then tell, through the distance of the two cameras, a
            little about the pose; but that distance is one for all the correspondences of a pair,
            which are not independent given the pose as the sum over them takes for granted, and
            nine out of ten of them repeat the same hint. "uniform" takes the azimuths of a
            mismatch as uniform, and finds far more poses of many correspondences; of 25, nine in
            ten of them mismatches, the paper's finds a few more (docs/results.md).
        seed : int
            The same seed gives the same table, whatever the number of threads.
        num_threads : int, optional
            Default: every core that the process may use.
        progress : callable, optional
            Called as ``progress(samples_done, samples_total)``.

        Returns
        -------
        DenseTable

        Raises
        ------
        ValueError
            If a parameter is out of its range.
        """
        simulator = simulator or CorrespondenceSimulator()
        if not MIN_BINS <= bins <= MAX_BINS:
            raise ValueError(f"bins: expected {MIN_BINS} to {MAX_BINS}, got {bins}")
        if num_samples < 1:
            raise ValueError(f"num_samples: expected at least 1, got {num_samples}")
        if mismatches not in ("uniform", "simulated"):
            raise ValueError(f"mismatches: expected 'uniform' or 'simulated', got {mismatches!r}")
        if mismatches == "uniform" and not 0.0 < simulator.mismatch < 1.0:
            raise ValueError(
                f"simulator: expected a mismatch share in (0, 1), got {simulator.mismatch}"
            )

        def learn(mismatch: float, samples: int, stream: int) -> NDArray[np.float64]:
            counts = count_simulated(
                dataclasses.replace(simulator, mismatch=mismatch),
                bins,
                samples,
                seed=2 * seed + stream,
                num_threads=num_threads,
                progress=progress,
            )
            return np.asarray(counts / counts.sum(), dtype=np.float64)

        if mismatches == "uniform":
            log_ratio = log_ratio_from_counts(
                learn(0.0, num_samples, 0), uniform=simulator.mismatch
            )
        else:
            # as many samples of either kind, weighted by their shares: less noise than drawing
            half = -(-num_samples // 2)
            mixed = (1.0 - simulator.mismatch) * learn(0.0, half, 0)
            mixed += simulator.mismatch * learn(1.0, half, 1)
            log_ratio = log_ratio_from_counts(mixed, uniform=EMPTY_CELL_SHARE)
        return cls(
            log_ratio,
            _learned(simulator, num_samples=num_samples, mismatches=mismatches, seed=seed),
        )

    @classmethod
    def from_pairs(
        cls,
        pairs: Iterable[Pair],
        *,
        bins: int = 32,
        uniform: float = 0.3,
        blur: float = 0.0,
        compensate: bool = True,
        source: str = "pairs",
    ) -> DenseTable:
        """Learn a table from real pairs of views with known relative pose (Algorithm 2).

        Parameters
        ----------
        pairs : iterable of (Correspondences, heading_l, heading_r)
            With the true headings, radians.
        bins : int
            Cells of every axis. Real data fills few: 16 or 32 are usual.
        uniform : float
            Share in (0, 1) of uniform azimuths mixed in, beside the data's own mismatches.
        blur : float
            Standard deviation in cells of a Gaussian over (u, v); 0, as in the paper, for none. It
            costs tables of up to 64 bins more than it gives, learned from 200 pairs or from 6,500;
            half a cell to one is worth trying with 128.
        compensate : bool
            Weight each sample by one over the frequency of its relative pose.
        source : str
            What the table's file says of the data.

        Returns
        -------
        DenseTable

        Raises
        ------
        ValueError
            If a parameter is out of its range or there is not one correspondence.
        """
        if not MIN_BINS <= bins <= MAX_BINS:
            raise ValueError(f"bins: expected {MIN_BINS} to {MAX_BINS}, got {bins}")
        if not 0.0 < uniform < 1.0:
            raise ValueError(f"uniform: expected a share in (0, 1), got {uniform}")
        histogram, num_samples = count_pairs(pairs, bins, compensate=compensate)
        return cls(
            log_ratio_from_counts(histogram, uniform=uniform, blur=blur),
            {
                "source": source,
                "num_samples": num_samples,
                "uniform": uniform,
                "blur": blur,
                "compensate": compensate,
            },
        )

    @classmethod
    def default(cls, *, bins: int = DEFAULT_BINS, progress: Progress | None = None) -> DenseTable:
        """Return the table of the paper's simulator; no download.

        Learned at its first use (seconds) and kept in the user's cache folder (`pflut info`).

        Parameters
        ----------
        bins : int
            128 suits panoramas. Perspective cameras measure more sharply: 256.
        progress : callable, optional
            Called as ``progress(samples_done, samples_total)`` while the table is learned.

        Returns
        -------
        DenseTable
        """
        path = cache_dir() / f"dense-{bins}.npz"
        try:
            table = cls.load(path)
            if table.bins == bins and table.learned_from == default_description(bins):
                return table
        except (OSError, ValueError):
            pass  # not there yet, or spoilt
        table = cls.from_simulation(
            bins=bins, num_samples=_default_samples(bins), progress=progress
        )
        table.save(path)
        return table

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table to a `.npz` file, atomically.

        Parameters
        ----------
        path : path
        """
        write_table(path, KIND, {"log_ratio": self.log_ratio}, self.learned_from)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> DenseTable:
        """Read a table from its file.

        Parameters
        ----------
        path : path

        Returns
        -------
        DenseTable

        Raises
        ------
        ValueError
            If the file is truncated, of another version or kind, or holds non-finite numbers.
        FileNotFoundError
            If there is no such file.
        """
        kind, arrays, learned_from = read_table(path)
        if kind != KIND:
            raise ValueError(f"{path}: a {kind} table, expected a {KIND} one")
        if "log_ratio" not in arrays:
            raise ValueError(f"{path}: damaged table, without log_ratio")
        try:
            return cls(arrays["log_ratio"], learned_from)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None


def _learned(
    simulator: CorrespondenceSimulator | None = None,
    *,
    num_samples: int,
    mismatches: str = "uniform",
    seed: int = 0,
) -> dict[str, Any]:
    """Describe a table learned from the simulator; what differs in this is another table."""
    return {
        "source": "simulation",
        "learning_version": LEARNING_VERSION,
        "simulator": dataclasses.asdict(simulator or CorrespondenceSimulator()),
        "mismatches": mismatches,
        "num_samples": int(num_samples),
        "seed": int(seed),
    }


def _default_samples(bins: int) -> int:
    return DEFAULT_SAMPLES * max(1, bins // DEFAULT_BINS)


def default_description(bins: int) -> dict[str, Any]:
    """Return what ``learned_from`` of the default table of so many bins says."""
    return _learned(num_samples=_default_samples(bins))
