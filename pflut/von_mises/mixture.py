"""A mixture of von Mises distributions over the relative poses of two views."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import TWO_PI, FloatArray, wrap_to_pi
from pflut.von_mises.bessel import log_i0
from pflut.von_mises.sine import log_density, quadrature

MAX_COMPONENTS = 160
"""Of a fit, by default; most have one or two."""
MODE_SEPARATION = float(np.radians(15.0))
"""Radians within which components are one mode, by default."""
LOG_UNIFORM = float(-2.0 * np.log(TWO_PI))
"""Log of the density over both headings where nothing is known."""


def _none() -> FloatArray:
    return np.empty(0)


def _no_pairs() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, eq=False)
class VonMisesMixture:
    """A density over (heading_l, heading_r): modes, bands of one rotation, and a uniform rest.

    Parameters
    ----------
    weights : array_like of shape (K,)
        Of the modes. All weights of the mixture sum to one.
    means : array_like of shape (K, 2)
        ``[heading_l, heading_r]``, radians; kept in (-pi, pi].
    concentrations : array_like of shape (K, 2)
        k1 and k2 of the sine model, not negative: one over a variance at the other angle's mean.
    couplings : array_like of shape (K,)
        c of the sine model, c^2 <= k1 k2; positive where the headings grow together.
    rotation_weights : array_like of shape (M,)
        Of the bands, in which the rotation psi = heading_l - heading_r + pi is known better than
        the headings: a turn on the spot.
    rotation_means, rotation_concentrations : array_like of shape (M,)
        Of psi, which is von Mises; radians, kept in (-pi, pi].
    uniform_weight : float
        Of a pose of which nothing is known.
    rotation_headings, rotation_heading_concentrations : array_like of shape (M,)
        Of heading_l along the band, which is von Mises and independent of psi. Default: zeros,
        all headings are as probable.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a value is out of its range.

    Notes
    -----
    A mode's log-density, with d the differences of the headings from the mean, is
    k1 cos d1 + k2 cos d2 + c sin d1 sin d2 - log C (see `pflut.von_mises.sine`).
    """

    weights: FloatArray = field(default_factory=_none)
    means: FloatArray = field(default_factory=_no_pairs)
    concentrations: FloatArray = field(default_factory=_no_pairs)
    couplings: FloatArray = field(default_factory=_none)
    rotation_weights: FloatArray = field(default_factory=_none)
    rotation_means: FloatArray = field(default_factory=_none)
    rotation_concentrations: FloatArray = field(default_factory=_none)
    uniform_weight: float = 0.0
    rotation_headings: FloatArray = field(default_factory=_none)
    rotation_heading_concentrations: FloatArray = field(default_factory=_none)

    def __post_init__(self) -> None:
        modes, bands = np.size(self.weights), np.size(self.rotation_weights)
        for name in ("rotation_headings", "rotation_heading_concentrations"):
            if bands and not np.size(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(bands))
        for entry in fields(self):
            name = entry.name
            if name == "uniform_weight":
                continue
            shape: tuple[int, ...] = (bands if name.startswith("rotation") else modes,)
            if name in ("means", "concentrations"):
                shape = (*shape, 2)
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if values.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name}: expected finite numbers, got {values}")
            if name.endswith(("weights", "concentrations")) and (values < 0.0).any():
                raise ValueError(f"{name}: expected numbers not negative, got {values.min()}")
            if name.endswith(("means", "headings")):
                values = np.asarray(wrap_to_pi(values)).reshape(shape)
            object.__setattr__(self, name, values)
        if (self.couplings**2 > (1.0 + 1e-9) * self.concentrations.prod(axis=1)).any():
            raise ValueError("couplings: expected c^2 <= k1 k2, got a mode with two maxima")
        object.__setattr__(self, "uniform_weight", float(self.uniform_weight))
        total = float(self.weights.sum() + self.rotation_weights.sum()) + self.uniform_weight
        if not (self.uniform_weight >= 0.0 and abs(total - 1.0) < 1e-6):
            raise ValueError(f"weights: expected a sum of one, got {total}")

    @property
    def num_components(self) -> int:
        """Modes and bands, without the uniform rest."""
        return len(self.weights) + len(self.rotation_weights)

    def component_log_densities(self, headings: ArrayLike) -> FloatArray:
        """Return the log-density of every component, weighted.

        Parameters
        ----------
        headings : array_like of shape (..., 2)
            ``[heading_l, heading_r]``, radians.

        Returns
        -------
        ndarray of shape (..., K + M + 1)
            The modes', the bands' and the uniform rest's log(weight density), per squared radian.
        """
        poses = np.asarray(headings, dtype=np.float64)
        psi = (poses[..., 0] - poses[..., 1] + np.pi)[..., None] - self.rotation_means
        along = poses[..., :1] - self.rotation_headings
        across = self.rotation_concentrations
        lengthwise = self.rotation_heading_concentrations
        bands = (
            -2.0 * (across * np.sin(0.5 * psi) ** 2 + lengthwise * np.sin(0.5 * along) ** 2)
            - (log_i0(across) - across)
            - (log_i0(lengthwise) - lengthwise)
            + LOG_UNIFORM
        )
        with np.errstate(divide="ignore"):  # the log of no weight
            return np.concatenate(
                [
                    log_density(poses, self.means, self.concentrations, self.couplings)
                    + np.log(self.weights),
                    bands + np.log(self.rotation_weights),
                    np.full((*poses.shape[:-1], 1), LOG_UNIFORM + np.log(self.uniform_weight)),
                ],
                axis=-1,
            )

    def log_density(self, headings: ArrayLike) -> FloatArray:
        """Return the log of the density at poses.

        Parameters
        ----------
        headings : array_like of shape (..., 2)
            ``[heading_l, heading_r]``, radians.

        Returns
        -------
        ndarray of shape (...)
            Nats, of probability a squared radian; -3.68 where nothing is known.
        """
        logs = self.component_log_densities(headings)
        peak = logs.max(axis=-1)
        safe = np.where(np.isfinite(peak), peak, 0.0)
        with np.errstate(divide="ignore"):
            return np.asarray(safe + np.log(np.exp(logs - safe[..., None]).sum(axis=-1)))

    def cell_probabilities(self, bins: int) -> FloatArray:
        """Return the probabilities of a grid's cells.

        A grid posterior is a density at the cells' centres, divided by the sum of all. So is each
        component here. The density times a cell's area is the same, but of components sharper than
        a cell: those a centre may miss, or meet where they are highest.

        Parameters
        ----------
        bins : int
            Cells of an axis.

        Returns
        -------
        ndarray of shape (bins, bins)
            They sum to one; as those of `pflut.GridPosterior`.
        """
        axis = (np.arange(bins) + 0.5) * (TWO_PI / bins)
        centers = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        logs = self.component_log_densities(centers).reshape(bins * bins, -1)
        weights = [*self.weights, *self.rotation_weights, self.uniform_weight]
        total = np.zeros(bins * bins)
        for log, weight in zip(logs.T, weights, strict=True):
            if weight > 0.0:
                share = np.exp(log - log.max())
                total += weight / share.sum() * share
        return total.reshape(bins, bins)

    def divergence(self, prob: ArrayLike) -> float:
        """Return the Kullback-Leibler divergence of a grid from the mixture.

        Parameters
        ----------
        prob : array_like of shape (B, B)
            The cells' probabilities, as `pflut.GridPosterior.prob`.

        Returns
        -------
        float
            The mean of log(prob / `cell_probabilities`) over the grid, nats.
        """
        grid = np.asarray(prob, dtype=np.float64)
        own = self.cell_probabilities(len(grid))
        possible = grid > 0.0
        ratio = np.log(grid[possible]) - np.log(np.maximum(own[possible], 1e-300))
        return float(grid[possible] @ ratio)

    def covariances(self) -> FloatArray:
        """Return the modes' covariances, those of the normal distributions with their curvature.

        Returns
        -------
        ndarray of shape (K, 2, 2)
            Of (heading_l, heading_r), radians^2. Of broad modes, with deviations above some 30
            degrees, they are too large, and of a mode with c^2 = k1 k2 infinite.
        """
        k1, k2 = self.concentrations.T
        c = self.couplings
        determinant = k1 * k2 - c * c
        infinite = np.diag([np.inf, np.inf])[..., None]
        entries = np.array([[k2, c], [c, k1]]) / np.where(determinant > 0.0, determinant, 1.0)
        chosen = np.where(determinant > 0.0, entries, infinite)
        return np.ascontiguousarray(chosen.transpose(2, 0, 1))

    def merged_modes(
        self, *, separation: float = MODE_SEPARATION
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the distinct modes: components beside each other describe one that is not normal.

        Parameters
        ----------
        separation : float
            Radians. The heaviest component takes in those whose means are nearer in both headings,
            then the heaviest that is left, and so on.

        Returns
        -------
        weights : ndarray of shape (n,)
            Descending; bands and the uniform rest have what is missing to one.
        means : ndarray of shape (n, 2)
            ``[heading_l, heading_r]``, radians in (-pi, pi].
        covariances : ndarray of shape (n, 2, 2)
            Radians^2, with the components' distances.
        """
        covariances = self.covariances()
        # a component without a covariance is as broad as what is merged
        flat = ~np.isfinite(covariances).all(axis=(1, 2))
        covariances[flat] = separation**2 * np.eye(2)
        left = np.ones(len(self.weights), dtype=bool)
        found = []
        while left.any():
            first = int(np.argmax(np.where(left, self.weights, -1.0)))
            offsets = wrap_to_pi(self.means - self.means[first]).reshape(-1, 2)
            near = left & (np.abs(offsets) < separation).all(axis=1)
            weights = self.weights[near]
            total = weights.sum()
            shares = weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))
            mean = shares @ offsets[near]
            apart = offsets[near] - mean
            spread = covariances[near] + apart[:, :, None] * apart[:, None, :]
            found.append((total, self.means[first] + mean, np.tensordot(shares, spread, axes=1)))
            left &= ~near
        found.sort(key=lambda mode: -mode[0])
        return (
            np.array([mode[0] for mode in found]),
            np.array(wrap_to_pi([mode[1] for mode in found])).reshape(-1, 2),
            np.array([mode[2] for mode in found]).reshape(-1, 2, 2),
        )

    def rotation_components(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what the modes and bands say of the rotation psi alone.

        Returns
        -------
        weights, means, concentrations : ndarray of shape (K + M,)
            Of von Mises distributions of psi: first the modes', then the bands'; the means are
            radians in (-pi, pi]. The rest of the weight is uniform.
        """
        covariances = self.covariances()
        variances = covariances[:, 0, 0] + covariances[:, 1, 1] - 2.0 * covariances[:, 0, 1]
        sharpness = 1.0 / variances
        means = wrap_to_pi(self.means[:, 0] - self.means[:, 1] + np.pi).reshape(-1)
        return (
            np.concatenate([self.weights, self.rotation_weights]),
            np.concatenate([means, self.rotation_means]),
            np.concatenate([sharpness, self.rotation_concentrations]),
        )

    def entropy(self) -> float:
        """Return the differential entropy in nats; 2 log(2 pi) = 3.68 where nothing is known.

        It may be negative: over a square radian a sharp mode has a density above one.
        """
        total = 0.0
        for k, weight in enumerate(self.weights):
            points, mass = quadrature(
                self.means[k], self.concentrations[k], float(self.couplings[k])
            )
            total -= float(weight * (mass @ self.log_density(points)))
        for k, weight in enumerate(self.rotation_weights):
            points, mass = self._band_quadrature(k)
            total -= float(weight * (mass @ self.log_density(points)))
        if self.uniform_weight > 0.0:
            axis = (np.arange(128) + 0.5) * (TWO_PI / 128)
            points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
            total -= self.uniform_weight * float(self.log_density(points).mean())
        return total

    def _band_quadrature(self, band: int) -> tuple[FloatArray, FloatArray]:
        """Give points and weights that integrate over a band."""
        concentrations = np.array(
            [self.rotation_heading_concentrations[band], self.rotation_concentrations[band]]
        )
        mean = np.array([self.rotation_headings[band], self.rotation_means[band]])
        points, mass = quadrature(mean, concentrations, 0.0, nodes=64)
        theta, psi = points.T
        return np.stack([theta, theta - psi + np.pi], axis=-1), mass

    def mode(self) -> tuple[float, float]:
        """Return the component's mean where the density is highest.

        Returns
        -------
        heading_l, heading_r : float
            Radians in (-pi, pi]; zeros where there is neither mode nor band.
        """
        bands = np.stack(
            [self.rotation_headings, self.rotation_headings - self.rotation_means + np.pi], axis=-1
        )
        candidates = np.concatenate([self.means, bands.reshape(-1, 2)])
        if not len(candidates):
            return 0.0, 0.0
        best = wrap_to_pi(candidates[int(np.argmax(self.log_density(candidates)))])
        return float(best[0]), float(best[1])
