"""The particle filter: predict with odometry, weight with a sensor model, resample."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pflut.geometry import FloatArray, as_poses, compose, relative_pose, wrap_to_pi
from pflut.localization.estimate import METHODS, Estimate, mass_near, summarize
from pflut.localization.filter_state import FilterState
from pflut.localization.history import History
from pflut.localization.hypotheses import Hypothesis, find_hypotheses
from pflut.localization.initial_poses import Bounds, gaussian_poses, uniform_poses
from pflut.localization.motion import MotionModel, as_odometry
from pflut.localization.particles import Particles
from pflut.localization.recovery import LikelihoodAverages, Recovery
from pflut.localization.resampling import Resampler, get_resampler
from pflut.localization.resampling_policy import EffectiveSizeBelow, ResamplingPolicy
from pflut.localization.sample_size import KLDSampling
from pflut.localization.sensor_model import SensorModel
from pflut.localization.weights import Weights


class ParticleFilter:
    """Monte Carlo localization with any motion model and any sensor model.

    Parameters
    ----------
    motion : MotionModel
        Moves particles: `DifferentialDrive`, `Omnidirectional` or an object with their `sample`.
    sensor : SensorModel
        Weighs particles: an object with ``log_likelihood(poses, observation) -> (N,)``.
    num_particles : int or KLDSampling
        How many particles resampling leaves: always so many, or as many as the posterior needs.
        The initialisations draw the most that there may be.
    resampling : str or callable
        "systematic", "stratified", "multinomial", "residual", "ssp", or a function
        ``(weights, n, rng) -> sorted int32 indices``.
    resample_when : ResamplingPolicy
        `EffectiveSizeBelow`, `EveryUpdates`, `Moved`, their combinations, or one's own. Particles
        that are too many or too few are resampled anyway.
    min_effective_share : float
        In [0, 1): an observation that would leave fewer effective particles than this share of
        those before is flattened by an exponent until it leaves as many (`tempering_exponent`). 0
        never does, which is Bayes' rule; 0.1 keeps a few thousand particles alive under likelihoods
        much sharper than their distances, and a lost robot's other hypotheses with them.
    hypothesis_temperature : float
        In (0, 1]: factor on the log-evidence by which an image tells clusters of particles apart,
        see `temper_hypotheses`. 1 is Bayes' rule; less keeps several hypotheses alive where places
        look alike, until an image speaks clearly. It needs log-likelihoods that are zero where an
        image says nothing, as those of `ReferenceImageModel`.
    recovery : Recovery, optional
        Finds a robot that was carried away. Without it a filter that has lost the robot may stay
        lost.
    history : int
        So many past moments are kept for observations that come late, see `update`; each takes 28
        bytes a particle, and each stamped motion is one.
    estimate_method : {"cluster", "mean"}
        See `estimate_from_particles`.
    rng : numpy.random.Generator or int, optional
        The same seed and the same calls give the same bytes.

    Attributes
    ----------
    degenerate_updates, dropped_updates : int
        Observations since the initialisation that were ignored, or came too late.

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
    Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), tables 4.3 and 8.2 to 8.4.
    """

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        *,
        num_particles: int | KLDSampling = 2000,
        resampling: str | Resampler = "systematic",
        resample_when: ResamplingPolicy = EffectiveSizeBelow(0.5),  # noqa: B008 (frozen)
        min_effective_share: float = 0.0,
        hypothesis_temperature: float = 1.0,
        recovery: Recovery | None = None,
        history: int = 0,
        estimate_method: str = "cluster",
        rng: np.random.Generator | int | None = None,
    ) -> None:
        if not isinstance(num_particles, KLDSampling) and num_particles < 1:
            raise ValueError(f"num_particles: expected at least 1, got {num_particles}")
        if not 0.0 <= min_effective_share < 1.0:
            raise ValueError(
                f"min_effective_share: expected a share in [0, 1), got {min_effective_share}"
            )
        if not 0.0 < hypothesis_temperature <= 1.0:
            raise ValueError(
                f"hypothesis_temperature: expected in (0, 1], got {hypothesis_temperature}"
            )
        if estimate_method not in METHODS:
            raise ValueError(f"estimate_method: expected one of {METHODS}, got {estimate_method!r}")
        self.motion = motion
        self.sensor = sensor
        self.num_particles = num_particles
        self.resample_when = resample_when
        self.min_effective_share = min_effective_share
        self.hypothesis_temperature = hypothesis_temperature
        self.recovery = recovery
        self.estimate_method = estimate_method
        self.rng = np.random.default_rng(rng)
        self.degenerate_updates = self.dropped_updates = 0
        self._resample = get_resampler(resampling)
        self.history = History(history).length  # which checks it
        self._averages = LikelihoodAverages()
        self._started: Particles | None = None

    def predict(self, odometry: ArrayLike, *, stamp: float | None = None) -> None:
        """Move each particle by the odometry and by noise of its own (table 8.2, line 4).

        Parameters
        ----------
        odometry : array_like of shape (3,)
            The motion since the last call in the robot's own old frame,
            ``geometry.relative_pose(before, after)``.
        stamp : float, optional
            Seconds: when the motion ended.

        Raises
        ------
        ValueError
            If the filter is not initialised, the odometry is not three finite numbers, or its stamp
            goes back.
        """
        check_stamp(stamp)
        increment = as_odometry(odometry)
        particles = self._particles.copy()
        if stamp is not None and particles.clocked and particles.delay(stamp) > 0.0:
            raise ValueError(
                f"stamp: expected odometry after {particles.stamp:.6f} s, got {stamp:.6f}"
            )
        moved = as_poses(self.motion.sample(particles.poses, odometry, self.rng), "motion.sample")
        if len(moved) != len(particles):
            raise ValueError(f"motion.sample: expected {len(particles)} poses, got {len(moved)}")
        particles.move(moved, increment, stamp)
        self._started = particles

    def update(self, observation: Any, *, stamp: float | None = None) -> Estimate:
        """Weight the particles with an observation, estimate the pose, resample if need be.

        Parameters
        ----------
        observation : object
            Handed to the sensor model.
        stamp : float, optional
            Seconds: when it was taken. One before the last motion is late: the particles of now
            are weighted by where they were then, as far back as ``history`` knows (between two
            moments as if they had moved evenly). One from before that is dropped and counted.

        Returns
        -------
        Estimate
            Of the pose at the last stamp, from the weighted particles before resampling, which
            would only add noise.

        Raises
        ------
        ValueError
            If the filter is not initialised, or the sensor model answers with another shape.
        """
        check_stamp(stamp)
        # a copy: no particle has changed if the sensor model fails
        particles = self._particles.copy()
        delay = particles.delay(stamp)
        then: FloatArray | None = particles.poses
        if delay > 0.0 and stamp is not None:
            then = particles.history.at(stamp)
        if then is None or np.isnan(then).all():
            self.dropped_updates += 1
            return replace(self.estimate(), delay=delay, dropped=True)
        observation = self._observed(observation)
        if delay == 0.0:
            particles.see(stamp)

        # the robot may have been carried away: table 8.3, line 13
        own, past = particles.weights, len(particles)
        then, carried_away = self._propose(particles, then, observation)
        proposed = len(particles) - past

        # importance weights: table 8.2, line 5
        log_likelihood = self._log_likelihood(then, proposed, observation, own, late=delay > 0.0)
        weights, poses = particles.weights.times(log_likelihood), particles.poses
        exponent, share, log_mean = 1.0, 0.0, None
        if weights is not None:
            log_mean = _log_mean(own, log_likelihood[:past]) if proposed else weights.log_mean
            share = weights.share_of_last(proposed)
            exponent = particles.weigh(
                weights,
                log_likelihood,
                min_effective_share=self.min_effective_share,
                hypothesis_temperature=self.hypothesis_temperature,
                proposed=proposed,
            )
        if proposed and (weights is None or not _raised(particles, proposed, carried_away)):
            particles.forget_last(proposed, None if weights is not None else own)
        particles.count_update(weights is not None)

        # estimate before resampling; however little an image may count, it may say "not here"
        estimate = summarize(particles.poses, particles.weights, method=self.estimate_method)
        confidence = estimate.confidence
        if weights is not None and weights is not particles.weights:
            confidence = min(confidence, mass_near(poses, weights.linear, estimate.pose))

        # taken over; what a million particles no longer need is freed
        self._started = particles
        del own, log_likelihood

        # resample when too few particles carry the weight: table 8.2, lines 8 to 11
        resampled = self._wrong_size(len(particles)) or (
            weights is not None and self.resample_when(particles.since)
        )
        if resampled:
            self._select(particles)

        self.degenerate_updates += weights is None
        if self.recovery is not None and log_mean is not None:
            slow, fast = self.recovery.alpha_slow, self.recovery.alpha_fast
            self._averages = self._averages.after(log_mean, slow, fast)
        return self._counted(
            estimate,
            confidence=confidence,
            log_mean_likelihood=None if log_mean == -np.inf else log_mean,
            likelihood_exponent=exponent,
            proposed_share=share,
            resampled=resampled,
            degenerate=weights is None,
            delay=delay,
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
            Seconds, of both.

        Returns
        -------
        Estimate
        """
        self.predict(odometry, stamp=stamp)
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
        particles = self._particles
        return self._counted(
            summarize(particles.poses, particles.weights, method=self.estimate_method)
        )

    def hypotheses(self, *, max_count: int = 5, min_weight: float = 0.05) -> list[Hypothesis]:
        """Give all places where the robot may be, the most probable first.

        Parameters
        ----------
        max_count : int
            At most so many.
        min_weight : float
            In (0, 1): less is no hypothesis.

        Returns
        -------
        list of Hypothesis
            As a rule the first one is the pose of `estimate`, which takes the heaviest
            neighbourhood; empty for a robot that may be anywhere.
        """
        return find_hypotheses(self.poses, self.weights, max_count=max_count, min_weight=min_weight)

    def initialize(
        self,
        poses: ArrayLike,
        log_weights: ArrayLike | None = None,
        *,
        stamp: float | None = None,
    ) -> None:
        """Start from particles of one's own.

        Parameters
        ----------
        poses : array_like of shape (N, 3)
            Any N >= 1; copied.
        log_weights : array_like of shape (N,), optional
            Not necessarily normalised. By default all weigh the same.
        stamp : float, optional
            Seconds: when the robot is there.

        Raises
        ------
        ValueError
            If shapes do not fit, a pose is not finite, a weight is NaN or +inf, or all are zero.
        """
        begin = as_poses(poses).copy()
        begin[:, 2] = wrap_to_pi(begin[:, 2])
        weights = Weights.of_poses(len(begin), log_weights)
        check_stamp(stamp)
        self._started = Particles(begin, weights, History(self.history))
        self._started.see(stamp)
        self._averages = LikelihoodAverages()
        self.degenerate_updates = self.dropped_updates = 0

    def initialize_uniform(
        self, bounds: Bounds, *, heading: float | tuple[float, float] | None = None
    ) -> None:
        """Start lost: particles uniform over a rectangle, see `uniform_poses`.

        Parameters
        ----------
        bounds : tuple (xmin, ymin, xmax, ymax)
            Metres.
        heading : float or tuple (from, to), optional
            Radians: the known heading, or an interval of it. By default the whole circle.
        """
        self.initialize(uniform_poses(bounds, self._most, self.rng, heading=heading))

    def initialize_gaussian(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        """Start from a pose that is known up to a covariance, see `gaussian_poses`.

        Parameters
        ----------
        mean : array_like of shape (3,)
            ``[x, y, heading]``.
        covariance : array_like of shape (3, 3)
            Symmetric, no eigenvalue below zero; zeros are allowed.
        """
        self.initialize(gaussian_poses(mean, covariance, self._most, self.rng))

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
        return FilterState(
            particles=self._particles.copy(),
            averages=self._averages,
            generator=dict(self.rng.bit_generator.state),
            degenerate_updates=self.degenerate_updates,
            dropped_updates=self.dropped_updates,
        )

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
        self._started = state.particles.copy(history=self.history)
        self._averages = state.averages
        self.degenerate_updates = state.degenerate_updates
        self.dropped_updates = state.dropped_updates

    @property
    def poses(self) -> FloatArray:
        """The particles, ``(N, 3)``: the filter's own array, not a copy; do not write to it.

        No call changes it: each makes a new one, so an array held on to stays as it was.
        """
        return self._particles.poses

    @property
    def log_weights(self) -> FloatArray:
        """The particles' log-weights, ``(N,)``, normalised; not a copy, as with `poses`."""
        return self._particles.weights.log

    @property
    def weights(self) -> FloatArray:
        """The particles' weights, ``(N,)``, their sum is one; not a copy, as with `poses`."""
        return self._particles.weights.linear

    @property
    def stamp(self) -> float | None:
        """Seconds: when the particles are where they are; None if nobody said."""
        return self._particles.stamp

    @property
    def _particles(self) -> Particles:
        if self._started is None:
            raise ValueError("the filter is not initialised: call one of its initialize methods")
        return self._started

    @property
    def _most(self) -> int:
        """The most particles that there may be."""
        if isinstance(self.num_particles, KLDSampling):
            return self.num_particles.max_particles
        return self.num_particles

    def _wrong_size(self, size: int) -> bool:
        """Whether there are more or fewer particles than there may be."""
        fewest = self._most
        if isinstance(self.num_particles, KLDSampling):
            fewest = self.num_particles.min_particles
        return not fewest <= size <= self._most

    def _select(self, particles: Particles) -> None:
        """Resample to as many particles as there should be."""
        weights, count = particles.weights.linear, self._most
        if isinstance(self.num_particles, KLDSampling):
            count = self.num_particles.sample_size(particles.poses, weights)
        particles.select(self._resample(weights, count, self.rng))

    def _observed(self, observation: Any) -> Any:
        """Look at an image once, though recovery and the sensor model both ask for it."""
        observe = getattr(self.sensor, "observe", None)
        is_image = isinstance(observation, np.ndarray) and observation.dtype == np.uint8
        if self.recovery is None or observe is None or not is_image:
            return observation
        return observe(observation)

    def _propose(
        self, particles: Particles, then: FloatArray, observation: Any
    ) -> tuple[FloatArray, float]:
        """Append proposals; give where all were at the image, and the probability of the new ones.

        Proposals of a late image are brought to now by motions that particles have made since.
        """
        if self.recovery is None:
            return then, 0.0
        poses, log_weights, probability = self.recovery.propose(
            observation, len(particles), self._averages, self.rng
        )
        moved = poses
        if then is not particles.poses:
            there = np.flatnonzero(np.isfinite(then).all(axis=1))
            chosen = self.rng.choice(there, len(poses))
            moved = compose(poses, relative_pose(then[chosen], particles.poses[chosen]))
        particles.append(moved, log_weights, probability)
        return np.concatenate([then, poses]), probability

    def _counted(self, estimate: Estimate, **more: Any) -> Estimate:
        """Say in an estimate when it is, what was ignored so far, and more."""
        return replace(
            estimate,
            **more,
            degenerate_updates=self.degenerate_updates,
            dropped_updates=self.dropped_updates,
            stamp=self.stamp,
        )

    def _log_likelihood(
        self, poses: FloatArray, proposed: int, observation: Any, weights: Weights, *, late: bool
    ) -> FloatArray:
        """Weigh particles and proposals where they were at the image.

        Particles that were not there yet, NaN, are worth the mean of the others.
        """
        there = np.isfinite(poses[:, 0]) if late else np.ones(1, bool)
        if there.all():
            return self._asked(poses, proposed, observation)
        log_likelihood = np.empty(len(poses))
        log_likelihood[there] = self._asked(poses[there], proposed, observation)
        own = there[: len(weights)]
        before, others = weights.log[own], None
        if (before > -np.inf).any():
            others = Weights.from_log(before).times(log_likelihood[: len(weights)][own])
        log_likelihood[~there] = np.nan if others is None else others.log_mean
        return log_likelihood

    def _asked(self, poses: FloatArray, proposed: int, observation: Any) -> FloatArray:
        """Ask the sensor model and check the shape of its answer."""
        apart = getattr(self.sensor, "log_likelihood_with_proposals", None)
        if proposed and apart is not None:
            answer = apart(poses, proposed, observation)
        else:
            answer = self.sensor.log_likelihood(poses, observation)
        log_likelihood = np.ascontiguousarray(answer, dtype=np.float64)
        if log_likelihood.shape != (len(poses),):
            raise ValueError(
                f"sensor.log_likelihood: expected shape ({len(poses)},), got {log_likelihood.shape}"
            )
        return log_likelihood


def _log_mean(weights: Weights, log_likelihood: FloatArray) -> float:
    """Give the log of the mean likelihood of weighted particles, -inf where they have none."""
    after = weights.times(np.ascontiguousarray(log_likelihood))
    return -np.inf if after is None else after.log_mean


def _raised(particles: Particles, proposed: int, probability: float) -> bool:
    """Whether an image speaks for proposals: their odds are more than twice those before it."""
    share = particles.weights.share_of_last(proposed)
    own = len(particles) - proposed
    return share * own >= 1.0 and share * (1.0 - probability) > 2.0 * probability * (1.0 - share)


def check_stamp(stamp: float | None) -> None:
    """Refuse a time that is none.

    Raises
    ------
    ValueError
    """
    if stamp is not None and not np.isfinite(stamp):
        raise ValueError(f"stamp: expected finite seconds, got {stamp}")
