"""The likelihood table: how probable a correspondence is at a relative pose."""

from __future__ import annotations

import dataclasses
import operator
import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from importlib.resources import as_file, files
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut._files import checksum
from pflut.correspondences import Correspondences
from pflut.geometry import FloatArray
from pflut.likelihood.axes import (
    ELEVATION_CELLS,
    PARALLAX_CELLS,
    RESIDUAL_CELLS,
    parallax_positions,
    residual_nodes,
)
from pflut.likelihood.counts import SHAPE_CELLS
from pflut.likelihood.fitting import fit, quality_ratio
from pflut.likelihood.known_pairs import Pair
from pflut.likelihood.learning import count_simulated
from pflut.likelihood.pair_learning import count_pairs
from pflut.likelihood.residual_kernels import (
    PairArrays,
    TableArrays,
    score,
    shape_cells,
    sines_cosines,
)
from pflut.likelihood.ridges import Ridges, make_ridges
from pflut.likelihood.sampling import Progress
from pflut.likelihood.storage import read_table, write_table
from pflut.simulation.correspondences import CorrespondenceSimulator

KIND = "residual"
SHIPPED = {"panorama": "default.npz", "home": "home.npz", "perspective": "perspective.npz"}
DEFAULT_BINS = 128
DEFAULT_SAMPLES = 64_000_000
DEFAULT_CLASSES = 4
LEARNING_VERSION = 1
"""Goes up when simulator, axes or fit change: the shipped tables are then learned anew."""
MIN_BINS, MAX_BINS = 4, 1024
QUALITY_CELLS = 20
"""Cells of the quality's axis, if a table has it, over [0, 1]."""
LEAST_ODDS = 1e-6
"""Nothing is surer to be a mismatch, or a true match, than that."""


def sines_and_cosines(
    azimuth_l: FloatArray, elevation_l: FloatArray, azimuth_r: FloatArray, elevation_r: FloatArray
) -> FloatArray:
    """Return (8, n): sines and cosines of each of four arrays of angles, radians, in turn."""
    out = np.empty((8, azimuth_l.size))
    sines_cosines(azimuth_l, elevation_l, azimuth_r, elevation_r, out)
    return out


def bearing_columns(correspondences: Correspondences) -> FloatArray:
    """Return (8, n): sines and cosines of azimuth_l, elevation_l, azimuth_r, elevation_r."""
    c = correspondences
    return sines_and_cosines(c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r)


def pair_columns(pairs: Sequence[Correspondences]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the columns (8, n) of many pairs, and (p + 1,) where each pair's begin and end."""
    names = ("azimuth_l", "elevation_l", "azimuth_r", "elevation_r")
    none = [np.empty(0)]
    angles = (np.concatenate(none + [getattr(pair, name) for pair in pairs]) for name in names)
    return sines_and_cosines(*angles), np.cumsum([0, *map(len, pairs)])


@dataclasses.dataclass(frozen=True, eq=False)
class LikelihoodTable:
    """Likelihood ratios of a correspondence by its residual, and by where its landmark would be.

    At a relative pose a correspondence has a residual (the distance of its bearings to the planar
    epipolar constraint, radians), and its landmark would stand somewhere: parallax, ratio of the
    slopes and elevation say where. The table holds how many times as often a true match is met so
    as a mismatch, of bearings that have nothing to do with each other. Nothing in it is a model of
    noise: all is counted.

    Depth is common to the correspondences of a pair: all of them are far if the views are near
    each other. The table has the density in several *depth classes*; the likelihood of a pair is
    the mean over them of the product over its correspondences.

    Parameters
    ----------
    density : ndarray of shape (PARALLAX_CELLS, SHAPE_CELLS, C), float32
        Density ratio of true matches and mismatches within the band of small residuals, over the
        parallax, the shape (ratio and elevation) and the depth class; see `pflut.likelihood.axes`.
    profile : ndarray of shape (ELEVATION_CELLS, RESIDUAL_CELLS + 1), float32
        Density ratio of the residual, at its nodes.
    mismatch : float
        Share in (0, 1) of mismatches among the correspondences, beforehand.
    quality : ndarray of shape (QUALITY_CELLS,), float32, optional
        Density ratio of the ratio-test score; without it quality is not looked at.
    bins : int
        Cells an axis of its grids, unless others are asked for. Any number will do.
    learned_from : dict
        How the table was learned; stored in its file.

    Raises
    ------
    ValueError
        If a shape is another, or a number is out of its range.

    References
    ----------
    O. Booij, B. Krose, Z. Zivkovic, "Efficient probabilistic planar robot motion estimation given
    pairs of images", RSS 2010: sections II and III, of which the residual is equation 8. Their own
    table is `pflut.likelihood.dense.DenseTable`.
    """

    density: NDArray[np.float32]
    profile: NDArray[np.float32]
    mismatch: float = 0.9
    quality: NDArray[np.float32] | None = None
    bins: int = DEFAULT_BINS
    learned_from: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        shapes = {
            "density": (PARALLAX_CELLS, SHAPE_CELLS, max(np.shape(self.density)[-1:] or (0,))),
            "profile": (ELEVATION_CELLS, RESIDUAL_CELLS + 1),
            "quality": (QUALITY_CELLS,),
        }
        for name, shape in shapes.items():
            if getattr(self, name) is None:
                continue
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float32)
            if values.shape != shape or not values.size:
                raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
            if not np.isfinite(values).all() or (values < 0.0).any():
                raise ValueError(f"{name}: expected finite numbers that are not negative")
            object.__setattr__(self, name, values)
        if not 0.0 < self.mismatch < 1.0:
            raise ValueError(f"mismatch: expected a share in (0, 1), got {self.mismatch}")
        object.__setattr__(self, "bins", check_bins(self.bins))

    @property
    def num_classes(self) -> int:
        """Depth classes."""
        return int(self.density.shape[2])

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the residuals of true matches, radians; robust, as learned."""
        nodes = residual_nodes()
        # a mismatch's residual is all but uniform where it is small
        profile = np.median(self.profile, axis=0)
        density = np.interp(np.linspace(0.0, nodes[-1], 4096), nodes, profile)
        cumulative = np.cumsum(density)
        median = float(np.searchsorted(cumulative, 0.5 * cumulative[-1])) / 4096.0 * nodes[-1]
        return float(max(median / 0.6745, 1e-4))

    @property
    def digest(self) -> str:
        """A hash of what its likelihoods depend on; its bins and how it was learned are none."""
        arrays = {"density": self.density, "profile": self.profile}
        if self.quality is not None:
            arrays["quality"] = self.quality
        return checksum(float(self.mismatch).hex(), arrays)

    @property
    def prior_odds(self) -> float:
        """Odds of a correspondence of being a true match, if nothing is known of it."""
        return min(max((1.0 - self.mismatch) / self.mismatch, LEAST_ODDS), 1.0 / LEAST_ODDS)

    @cached_property
    def arrays(self) -> TableArrays:
        """What the kernels take of the table."""
        return TableArrays(parallax_positions(), self.density, self.profile)

    @cached_property
    def _ridges(self) -> dict[int, Ridges]:
        return {}

    def ridges(self, bins: int | None = None) -> Ridges:
        """Return what grids of so many bins are made of; made at their first use.

        Parameters
        ----------
        bins : int, optional
            Default: the table's own.

        Returns
        -------
        Ridges
        """
        bins = self.bins if bins is None else check_bins(bins)
        if bins not in self._ridges:
            self._ridges[bins] = make_ridges(self.density.mean(axis=2), self.profile, bins)
        return self._ridges[bins]

    def with_bins(self, bins: int) -> LikelihoodTable:
        """Return the same table with other grids.

        Parameters
        ----------
        bins : int
            Cells an axis.

        Returns
        -------
        LikelihoodTable
        """
        return dataclasses.replace(self, bins=bins)

    def odds(self, correspondences: Correspondences) -> FloatArray:
        """Return each correspondence's odds of being a true match, before any pose is known.

        Parameters
        ----------
        correspondences : Correspondences
            Their quality counts where they have it and the table knows of it.

        Returns
        -------
        ndarray of shape (n,)
        """
        odds: FloatArray = np.full(len(correspondences), self.prior_odds)
        if self.quality is not None and correspondences.quality is not None:
            cells = (correspondences.quality * QUALITY_CELLS).astype(np.int64)
            odds = odds * self.quality[cells.clip(0, QUALITY_CELLS - 1)]
            odds = odds.clip(LEAST_ODDS, 1.0 / LEAST_ODDS)
        return odds

    def log_likelihood_grid(
        self,
        correspondences: Correspondences,
        bins: int | None = None,
        *,
        window: NDArray[np.int64] | None = None,
    ) -> NDArray[np.float32]:
        """Sum the correspondences' log-likelihood ratios over the grid of poses.

        Each correspondence adds a ridge along its curve, in all depth classes together.

        Parameters
        ----------
        correspondences : Correspondences
        bins : int, optional
            Cells an axis; default: the table's own.
        window : ndarray of shape (2, 2), int64, optional
            The first cell, in [0, B), and how many, at most B, of heading_l and of heading_r,
            around the circle: the others may hold anything, and cost little.

        Returns
        -------
        ndarray of shape (B, B), float32
            Over (heading_l, heading_r); the cell (i, j) is centred on
            ((i + 1/2) 2 pi / B, (j + 1/2) 2 pi / B). Zero everywhere without correspondences.

        Raises
        ------
        ValueError
            If there are no such cells.
        """
        columns = bearing_columns(correspondences)
        odds = self.odds(correspondences)
        if window is not None:
            window = check_window(window, self.bins if bins is None else bins)
        return self.ridges(bins).grid(columns, self.shapes(columns), odds, window)

    def log_likelihood(self, correspondences: Correspondences, headings: ArrayLike) -> FloatArray:
        """Compute the log-likelihood ratio at poses, with no grid.

        Parameters
        ----------
        correspondences : Correspondences
        headings : array_like of shape (m, 2)
            ``[heading_l, heading_r]``, radians.

        Returns
        -------
        ndarray of shape (m,)
            Of "the views are so related" to "all of them are mismatches".

        Raises
        ------
        ValueError
            If the shape is another.
        """
        poses = np.ascontiguousarray(np.atleast_2d(np.asarray(headings, dtype=np.float64)))
        if poses.ndim != 2 or poses.shape[1] != 2:
            raise ValueError(f"headings: expected shape (m, 2), got {poses.shape}")
        columns, odds = bearing_columns(correspondences), self.odds(correspondences)
        first = np.array([0, len(odds)])
        pair = PairArrays(columns, self.shapes(columns), odds, first)
        out = np.empty(len(poses))
        score(pair, poses, np.zeros(len(poses), np.int64), self.arrays, out)
        return out - float(np.log1p(odds).sum())

    @staticmethod
    def shapes(columns: FloatArray) -> NDArray[np.int64]:
        """Return the cells of ratio and elevation of correspondences (8, n)."""
        cells = np.empty(columns.shape[1], np.int64)
        shape_cells(columns, cells)
        return cells

    @classmethod
    def from_simulation(
        cls,
        *,
        num_samples: int = DEFAULT_SAMPLES,
        simulator: CorrespondenceSimulator | None = None,
        num_classes: int = DEFAULT_CLASSES,
        bins: int = DEFAULT_BINS,
        seed: int = 0,
        num_threads: int | None = None,
        progress: Progress | None = None,
    ) -> LikelihoodTable:
        """Learn a table from the simulator.

        Parameters
        ----------
        num_samples : int
            Simulated correspondences, half of them true and half of them mismatches. Fewer than the
            default cost accuracy, the more the less noise: at 0.005 rad a table of 4 million is
            clearly worse than one of 64 million.
        simulator : CorrespondenceSimulator, optional
            Noise, tilt, scene and field of view; its share of mismatches becomes the table's.
            Default: the paper's, with 90 % mismatches.
        num_classes : int
            Depth classes.
        bins : int
            Cells an axis of the grids.
        seed : int
            The same seed gives the same table, whatever the number of threads.
        num_threads : int, optional
            Default: every core that the process may use.
        progress : callable, optional
            Called as ``progress(samples_done, samples_total)``.

        Returns
        -------
        LikelihoodTable

        Raises
        ------
        ValueError
            If a parameter is out of its range.
        """
        simulator = simulator or CorrespondenceSimulator()
        check_bins(bins)
        if num_samples < 1:
            raise ValueError(f"num_samples: expected at least 1, got {num_samples}")
        if not 1 <= num_classes <= 32:
            raise ValueError(f"num_classes: expected 1 to 32, got {num_classes}")
        if not 0.0 < simulator.mismatch < 1.0:
            raise ValueError(
                f"simulator: expected a mismatch share in (0, 1), got {simulator.mismatch}"
            )
        counts = count_simulated(
            simulator,
            num_samples,
            num_classes=num_classes,
            seed=seed,
            num_threads=num_threads,
            progress=progress,
        )
        density, profile = fit(counts)
        return cls(
            density,
            profile,
            mismatch=simulator.mismatch,
            bins=bins,
            learned_from={
                "source": "simulation",
                "learning_version": LEARNING_VERSION,
                "simulator": dataclasses.asdict(simulator),
                "num_samples": int(num_samples),
                "num_classes": int(num_classes),
                "seed": int(seed),
            },
        )

    @classmethod
    def from_pairs(
        cls,
        pairs: Iterable[Pair],
        *,
        prior: LikelihoodTable | None = None,
        prior_samples: float = 2000.0,
        compensate: bool = True,
        bins: int | None = None,
        source: str = "pairs",
        seed: int = 0,
    ) -> LikelihoodTable:
        """Learn a table from real pairs of views with known relative pose.

        Real pairs are few: what they do not say is filled from another table. The share of
        mismatches is learned too, and if the correspondences have a quality, what it is worth.

        Parameters
        ----------
        pairs : iterable of (Correspondences, heading_l, heading_r)
            With the true headings, radians.
        prior : LikelihoodTable, optional
            Default: `default`.
        prior_samples : float
            The prior counts as so many true matches.
        compensate : bool
            Weight each sample by one over the frequency of its relative pose (Algorithm 2).
        bins : int, optional
            Cells an axis of the grids; default: the prior's.
        source : str
            What the table's file says of the data.
        seed : int
            Of the random poses at which mismatches are met.

        Returns
        -------
        LikelihoodTable

        Raises
        ------
        ValueError
            If a parameter is out of its range, or there is not one correspondence.
        """
        prior = cls.default() if prior is None else prior
        if not 0.0 < prior_samples < np.inf:
            raise ValueError(f"prior_samples: expected a positive number, got {prior_samples}")
        counts, mismatch, num_samples = count_pairs(
            pairs,
            num_classes=prior.num_classes,
            noise=prior.noise,
            compensate=compensate,
            quality_cells=QUALITY_CELLS,
            seed=seed,
        )
        density, profile = fit(
            counts, mismatch, prior=(prior.density, prior.profile), prior_samples=prior_samples
        )
        return cls(
            density,
            profile,
            mismatch=mismatch,
            quality=quality_ratio(counts),
            bins=prior.bins if bins is None else bins,
            learned_from={
                "source": source,
                "learning_version": LEARNING_VERSION,
                "num_samples": num_samples,
                "prior_samples": float(prior_samples),
                "prior": prior.learned_from,
                "compensate": compensate,
                "seed": int(seed),
            },
        )

    @classmethod
    def default(
        cls,
        camera: Literal["panorama", "home", "perspective"] = "panorama",
        *,
        bins: int = DEFAULT_BINS,
    ) -> LikelihoodTable:
        """Return a table that comes with pflut, learned from the simulator.

        Parameters
        ----------
        camera : {"panorama", "home", "perspective"}
            "panorama" is learned from the paper's scene with 0.01 rad of noise, and holds on level
            floors for any camera: noise, tilt and calibration of real drives are rarely less.
            "home" is learned from landmarks on the walls of rooms with half that noise: for
            relative poses of panoramas taken indoors by a robot that does not lean. "perspective"
            is learned with two cameras of 90 by 70 degrees that look roughly the same way, and a
            noise of 1 pixel at a focal length of 500: for image pairs that are as sharp as that.
            `pflut lut build` with its default options makes the first one, ``--scene box --noise
            0.005`` the second.
        bins : int
            Cells an axis of its grids: 128 suits panoramas; perspective cameras measure more
            sharply, 256.

        Returns
        -------
        LikelihoodTable

        Raises
        ------
        ValueError
            If the camera is another.
        """
        if camera not in SHIPPED:
            raise ValueError(f"camera: expected one of {', '.join(SHIPPED)}, got {camera!r}")
        with as_file(files("pflut.likelihood").joinpath(SHIPPED[camera])) as path:
            table = cls.load(os.fspath(path))
        return table.with_bins(bins)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table to a `.npz` file, atomically.

        Parameters
        ----------
        path : path
        """
        arrays: dict[str, NDArray[Any]] = {
            "density": self.density,
            "profile": self.profile,
            "mismatch": np.array(self.mismatch),
            "bins": np.array(self.bins),
        }
        if self.quality is not None:
            arrays["quality"] = self.quality
        write_table(path, KIND, arrays, self.learned_from)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LikelihoodTable:
        """Read a table from its file.

        Parameters
        ----------
        path : path

        Returns
        -------
        LikelihoodTable

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
        missing = {"density", "profile", "mismatch", "bins"} - arrays.keys()
        if missing:
            raise ValueError(f"{path}: damaged table, without {', '.join(sorted(missing))}")
        try:
            return cls(
                arrays["density"],
                arrays["profile"],
                float(arrays["mismatch"]),
                arrays.get("quality"),
                int(arrays["bins"]),
                learned_from,
            )
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from None


def check_window(window: ArrayLike, bins: int) -> NDArray[np.int64]:
    """Return the first cells and numbers of cells as (2, 2); raise ValueError if there are none."""
    cells = np.asarray(window)
    if cells.shape != (2, 2) or cells.dtype.kind not in "iu":
        raise ValueError(
            f"window: expected whole numbers of shape (2, 2), got {cells.dtype} of {cells.shape}"
        )
    first, count = cells.T
    if (first < 0).any() or (first >= bins).any() or (count < 0).any() or (count > bins).any():
        raise ValueError(
            f"window: expected first cells in [0, {bins}) and at most {bins} cells, "
            f"got {cells.tolist()}"
        )
    return np.ascontiguousarray(cells, dtype=np.int64)


def check_bins(bins: int) -> int:
    """Return the number of cells an axis; raise ValueError if a grid cannot have so many."""
    try:
        cells = operator.index(bins)
    except TypeError:
        raise ValueError(f"bins: expected an integer, got {bins!r}") from None
    if not MIN_BINS <= cells <= MAX_BINS:
        raise ValueError(f"bins: expected {MIN_BINS} to {MAX_BINS}, got {cells}")
    return cells
