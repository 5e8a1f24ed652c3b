"""The particle filter: predict with odometry, weight with a sensor model, resample."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, as_poses, wrap_to_pi
from pflut.localization.estimate import METHODS, Estimate, summarize
from pflut.localization.filter_state import FilterState
from pflut.localization.gaussian import as_gaussian, square_root
from pflut.localization.motion import MotionModel
from pflut.localization.resampling import Resampler, get_resampler, take
from pflut.localization.tempering import tempering_exponent
from pflut.localization.weights import Weights


class SensorModel(Protocol):
    """What the particle filter asks of a sensor model."""

    def log_likelihood(self, poses: FloatArray, observation: Any) -> ArrayLike:
        """Give the observation's log-likelihood at each of the poses.

        Parameters
        ----------
        poses : ndarray of shape (N, 3)
            ``[x, y, heading]``; not to be changed.
        observation : object
            Whatever `ParticleFilter.update` was handed.

        Returns
        -------
        array_like of shape (N,)
            Up to a constant; -inf rules a pose out.
        """
        ...  # pragma: no cover


class ParticleFilter:
    """Monte Carlo localization with any motion model and any sensor model.

    Parameters
    ----------
    motion : MotionModel
        Moves particles: `DifferentialDrive`, `Omnidirectional` or an object with their `sample`.
    sensor : SensorModel
        Weighs particles: an object with ``log_likelihood(poses, observation) -> (N,)``.
    num_particles : int
        How many particles the initialisations draw and resampling leaves.
    resampling : str or callable
        "systematic", "stratified", "multinomial", "residual", "ssp", or a function
        ``(weights, n, rng) -> sorted int32 indices``.
    ess_threshold : float
        In [0, 1]: resample when the effective sample size falls below this share of the number
        of particles. 1 resamples after every update that changes the weights, 0 never.
    min_effective_share : float
        In [0, 1): an observation that would leave fewer effective particles than this share of
        them is flattened by an exponent until it leaves as many (`tempering_exponent`). 0 never
        does, which is Bayes' rule; 0.1 keeps a few thousand particles alive under likelihoods
        much sharper than their distances, and a lost robot's other hypotheses with them.
    estimate_method : {"cluster", "mean"}
        See `estimate_from_particles`.
    rng : numpy.random.Generator or int, optional
        The same seed and the same calls give the same bytes.

    Raises
    ------
    ValueError
        If an option is out of its range.

    Notes
    -----
    **Degenerate weights.** An observation whose log-likelihoods hold a NaN or +inf, or rule out
    every particle, is ignored: the weights stay as they were. It is counted in
    ``degenerate_updates`` and flagged in the estimate. No NaN ever comes out.

    **More particles at the start.** `initialize` takes any number of poses; the first update
    resamples them to ``num_particles``. So a lost robot can start with many.

    References
    ----------
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), tables 4.3 and 8.2.
    """

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        *,
        num_particles: int = 2000,
        resampling: str | Resampler = "systematic",
        ess_threshold: float = 0.5,
        min_effective_share: float = 0.0,
        estimate_method: str = "cluster",
        rng: np.random.Generator | int | None = None,
    ) -> None:
        if num_particles < 1:
            raise ValueError(f"num_particles: expected at least 1, got {num_particles}")
        if not 0.0 <= ess_threshold <= 1.0:
            raise ValueError(f"ess_threshold: expected a share in [0, 1], got {ess_threshold}")
        if not 0.0 <= min_effective_share < 1.0:
            raise ValueError(
                f"min_effective_share: expected a share in [0, 1), got {min_effective_share}"
            )
        if estimate_method not in METHODS:
            raise ValueError(f"estimate_method: expected one of {METHODS}, got {estimate_method!r}")
        self.motion = motion
        self.sensor = sensor
        self.num_particles = num_particles
        self.ess_threshold = ess_threshold
        self.min_effective_share = min_effective_share
        self.estimate_method = estimate_method
        self.rng = np.random.default_rng(rng)
        self.degenerate_updates = 0
        self._resample = get_resampler(resampling)
        self._poses: FloatArray | None = None
        self._weights = Weights.uniform(1)

    def predict(self, odometry: ArrayLike) -> None:
        """Move each particle by the odometry and by noise of its own (table 8.2, line 4).

        Parameters
        ----------
        odometry : array_like of shape (3,)
            The motion since the last call in the robot's own old frame,
            ``geometry.relative_pose(before, after)``.

        Raises
        ------
        ValueError
            If the filter is not initialised, or the odometry is not three finite numbers.
        """
        moved = as_poses(self.motion.sample(self.poses, odometry, self.rng), "motion.sample")
        if len(moved) != len(self._weights):
            raise ValueError(
                f"motion.sample: expected {len(self._weights)} poses, got {len(moved)}"
            )
        self._poses = moved

    def update(self, observation: Any, *, stamp: float | None = None) -> Estimate:
        """Weight the particles with an observation, estimate the pose, resample if need be.

        Parameters
        ----------
        observation : object
            Handed to the sensor model.
        stamp : float, optional
            Seconds; handed on to the estimate.

        Returns
        -------
        Estimate
            From the weighted particles before resampling, which would only add noise.

        Raises
        ------
        ValueError
            If the filter is not initialised, or the sensor model answers with another shape.
        """
        # importance weights: table 8.2, line 5
        log_likelihood = self._log_likelihood(observation)
        weights = self._weights.times(log_likelihood)
        degenerate = weights is None
        exponent = 1.0
        if weights is None:
            self.degenerate_updates += 1
        elif weights.effective_sample_size < self.min_effective_share * len(weights):
            exponent = tempering_exponent(self._weights, log_likelihood, self.min_effective_share)
            tempered = self._weights.times(exponent * log_likelihood)
            self._weights = weights if tempered is None else tempered
        else:
            self._weights = weights

        estimate = self.estimate()

        # resample when too few particles carry the weight: table 8.2, lines 8 to 11
        size = estimate.num_particles
        few = estimate.effective_sample_size < self.ess_threshold * size
        resampled = few or size != self.num_particles
        if resampled:
            indices = self._resample(self._weights.linear, self.num_particles, self.rng)
            self._poses = take(self.poses, indices)
            self._weights = Weights.uniform(self.num_particles)

        return replace(
            estimate,
            log_mean_likelihood=None if weights is None else weights.log_mean,
            likelihood_exponent=exponent,
            resampled=resampled,
            degenerate=degenerate,
            stamp=stamp,
        )

    def step(
        self, odometry: ArrayLike, observation: Any, *, stamp: float | None = None
    ) -> Estimate:
        """Predict, then update: one turn of the loop.

        Parameters
        ----------
        odometry : array_like of shape (3,)
            As in `predict`.
        observation : object
            As in `update`.
        stamp : float, optional
            Seconds; handed on to the estimate.

        Returns
        -------
        Estimate
        """
        self.predict(odometry)
        return self.update(observation, stamp=stamp)

    def estimate(self) -> Estimate:
        """Estimate the pose from the particles as they are now, as after a `predict`.

        Returns
        -------
        Estimate

        Raises
        ------
        ValueError
            If the filter is not initialised.
        """
        estimate = summarize(self.poses, self._weights, method=self.estimate_method)
        return replace(estimate, degenerate_updates=self.degenerate_updates)

    def initialize(self, poses: ArrayLike, log_weights: ArrayLike | None = None) -> None:
        """Start from particles of one's own.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            Any N >= 1; copied.
        log_weights : array_like of shape (N,), optional
            Not necessarily normalised. By default all weigh the same.

        Raises
        ------
        ValueError
            If shapes do not fit, a pose is not finite, a weight is NaN or +inf, or all are zero.
        """
        particles = as_poses(poses).copy()
        particles[:, 2] = wrap_to_pi(particles[:, 2])
        weights = Weights.of_poses(len(particles), log_weights)
        self._poses, self._weights, self.degenerate_updates = particles, weights, 0

    def initialize_uniform(
        self,
        bounds: tuple[float, float, float, float],
        *,
        heading: float | tuple[float, float] | None = None,
    ) -> None:
        """Start lost: particles uniform over a rectangle.

        Parameters
        ----------
        bounds : tuple (xmin, ymin, xmax, ymax)
            Metres.
        heading : float or tuple (from, to), optional
            Radians: the known heading, or an interval of it. By default the whole circle.

        Raises
        ------
        ValueError
            If the bounds are not finite or the wrong way round.
        """
        low_x, low_y, high_x, high_y = bounds
        if not (np.isfinite(bounds).all() and low_x <= high_x and low_y <= high_y):
            raise ValueError(f"bounds: expected finite (xmin, ymin, xmax, ymax), got {bounds}")
        interval = (-np.pi, np.pi) if heading is None else np.broadcast_to(heading, (2,))
        low = [low_x, low_y, interval[0]]
        high = [high_x, high_y, interval[1]]
        if not (np.isfinite(interval).all() and interval[0] <= interval[1]):
            raise ValueError(f"heading: expected finite radians, from <= to, got {heading}")
        self.initialize(self.rng.uniform(low, high, (self.num_particles, 3)))

    def initialize_gaussian(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        """Start from a pose that is known up to a covariance.

        Parameters
        ----------
        mean : array_like of shape (3,)
            ``[x, y, heading]``.
        covariance : array_like of shape (3, 3)
            Symmetric, no eigenvalue below zero; zeros are allowed.

        Raises
        ------
        ValueError
            If the covariance is none.
        """
        center, matrix = as_gaussian(mean, covariance)
        normals = self.rng.standard_normal((self.num_particles, 3))
        self.initialize(center + np.einsum("ik,kj->ij", normals, square_root(matrix)))

    def state(self) -> FilterState:
        """Give all that the filter has become, to be saved and resumed to the last bit.

        Returns
        -------
        FilterState
            ``state.save(path)``, later ``pf.restore(FilterState.load(path))``.

        Raises
        ------
        ValueError
            If the filter is not initialised.
        """
        generator = dict(self.rng.bit_generator.state)
        return FilterState(self.poses, self._weights, generator, self.degenerate_updates)

    def restore(self, state: FilterState) -> None:
        """Go on from a state, with the models and options that this filter was made with.

        Parameters
        ----------
        state : FilterState
            Of a filter with the same ones: what follows is then the same to the last bit.

        Raises
        ------
        ValueError
            If the state is of no random generator that NumPy has.
        """
        self.rng = state.random_generator()
        self._poses, self._weights = state.poses, state.weights
        self.degenerate_updates = state.degenerate_updates

    @property
    def poses(self) -> FloatArray:
        """The particles, ``(N, 3)``: the filter's own array, not a copy; do not write to it.

        No call changes it: each makes a new one, so an array held on to stays as it was.
        """
        if self._poses is None:
            raise ValueError("the filter is not initialised: call one of its initialize methods")
        return self._poses

    @property
    def log_weights(self) -> FloatArray:
        """The particles' log-weights, ``(N,)``, normalised; not a copy, as with `poses`."""
        return self._weights.log

    @property
    def weights(self) -> FloatArray:
        """The particles' weights, ``(N,)``, their sum is one; not a copy, as with `poses`."""
        return self._weights.linear

    def _log_likelihood(self, observation: Any) -> FloatArray:
        """Ask the sensor model and check the shape of its answer."""
        answer = self.sensor.log_likelihood(self.poses, observation)
        log_likelihood = np.ascontiguousarray(answer, dtype=np.float64)
        if log_likelihood.shape != (len(self._weights),):
            raise ValueError(
                f"sensor.log_likelihood: expected shape ({len(self._weights)},), "
                f"got {log_likelihood.shape}"
            )
        return log_likelihood
