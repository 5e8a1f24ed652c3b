"""Replay a dataset through the filter: one step an image."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.localization.estimate import Estimate


class Filter(Protocol):
    """What the localizer asks of a filter: `ParticleFilter` has it, and its baselines have."""

    sensor: Any

    def predict(self, odometry: FloatArray, /, *, stamp: float | None = None) -> None: ...  # noqa: D102

    def update(self, observation: Any, /, *, stamp: float | None = None) -> Estimate: ...  # noqa: D102


class Drive(Protocol):
    """What the localizer asks of a dataset (`pflut.datasets.Dataset` has it)."""

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def stamps(self) -> FloatArray: ...  # noqa: D102

    @property
    def ground_truth(self) -> FloatArray | None: ...  # noqa: D102

    @property
    def odometry(self) -> FloatArray | None: ...  # noqa: D102

    @property
    def query_indices(self) -> NDArray[Any]: ...  # noqa: D102

    def image(self, i: int, /) -> NDArray[np.uint8]: ...  # noqa: D102

    def odometry_between(self, i: int, j: int, /) -> FloatArray: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Step:
    """One image of a replay.

    Parameters
    ----------
    index : int
        Which frame of the dataset.
    stamp : float
        Seconds.
    estimate : Estimate
    ground_truth : ndarray of shape (3,) or None
        The frame's true pose, where the dataset knows it.
    odometry : ndarray of shape (3,)
        The frame's pose in the odometry's frame.
    timings : dict
        Seconds a stage: "image" (reading), "features" (the observation from the image),
        "predict", "update" (the likelihood, the estimate and resampling).
    """

    index: int
    stamp: float
    estimate: Estimate
    ground_truth: FloatArray | None
    odometry: FloatArray
    timings: dict[str, float]


class Localizer:
    """Iterate over a dataset's query images: predict with odometry, update with the image.

    The filter carries the state: initialise it first, and again for a second replay.

    Parameters
    ----------
    dataset : Dataset
        With odometry.
    pf : ParticleFilter
        Or another filter with ``predict`` and ``update``, as `ExtendedKalmanFilter` or
        `DeadReckoning`. Initialised where the robot may be at the first image; that is an update
        without a predict.
    observations : callable, optional
        ``(index) -> observation`` for the sensor, instead of the dataset's image: features that
        were computed before, say. By default the image, turned into an observation once by the
        sensor's ``observe(image)`` where it has that.
    indices : sequence of int, optional
        The frames to go through, in increasing order; by default the dataset's query frames.
    resume_from : int, optional
        The frame that the filter has seen last, of one that is resumed: odometry goes on from
        there, so that two halves of a drive are the same as the whole.

    Attributes
    ----------
    indices : tuple of int
        The frames of the replay.
    skipped : tuple of int
        The frames left out because they have no odometry; it is bridged over them.

    Raises
    ------
    ValueError
        If the dataset has no odometry, or the frames are not in increasing order.
    """

    def __init__(
        self,
        dataset: Drive,
        pf: Filter,
        *,
        observations: Callable[[int], Any] | None = None,
        indices: Sequence[int] | None = None,
        resume_from: int | None = None,
    ) -> None:
        if dataset.odometry is None:
            raise ValueError(f"dataset {dataset.name!r}: has no odometry, a replay needs it")
        chosen = np.asarray(dataset.query_indices if indices is None else indices, dtype=np.int64)
        if (np.diff(chosen) <= 0).any():
            raise ValueError("indices: expected increasing frame numbers")
        if resume_from is not None and (
            not 0 <= resume_from < len(dataset.odometry)
            or (len(chosen) and chosen[0] <= resume_from)
            or not np.isfinite(dataset.odometry[resume_from]).all()
        ):
            raise ValueError(
                f"resume_from: expected a frame with odometry before the others, got {resume_from}"
            )
        known = np.isfinite(dataset.odometry[chosen]).all(axis=1)
        self.dataset = dataset
        self.pf = pf
        self.indices = tuple(chosen[known].tolist())
        self.skipped = tuple(chosen[~known].tolist())
        self._observations = observations
        self._odometry = dataset.odometry
        self._resume_from = resume_from

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.indices)

    def __iter__(self) -> Iterator[Step]:
        """Replay: yield a `Step` after each image."""
        before = self._resume_from
        for index in self.indices:
            timings: dict[str, float] = {}
            observation = self._observe(index, timings)
            stamp = float(self.dataset.stamps[index])

            start = perf_counter()
            if before is not None:
                moved = self.dataset.odometry_between(before, index)
                self.pf.predict(moved, stamp=stamp)
            predicted = perf_counter()
            estimate = self.pf.update(observation, stamp=stamp)
            timings["predict"] = predicted - start
            timings["update"] = perf_counter() - predicted

            yield Step(
                index, stamp, estimate, self._truth(index), self._odometry[index].copy(), timings
            )
            before = index

    def run(self, *, progress: Callable[[int, int], None] | None = None) -> list[Step]:
        """Replay to the end.

        Parameters
        ----------
        progress : callable, optional
            Called as ``progress(done, total)`` after each step.

        Returns
        -------
        list of Step
        """
        steps = []
        for step in self:
            steps.append(step)
            if progress is not None:
                progress(len(steps), len(self))
        return steps

    def _observe(self, index: int, timings: dict[str, float]) -> Any:
        """Get a frame's observation, and time reading and features apart."""
        start = perf_counter()
        if self._observations is not None:
            observation = self._observations(index)
            timings["image"], timings["features"] = 0.0, perf_counter() - start
            return observation
        image = self.dataset.image(index)
        read = perf_counter()
        observe = getattr(self.pf.sensor, "observe", None)
        observation = image if observe is None else observe(image)
        timings["image"], timings["features"] = read - start, perf_counter() - read
        return observation

    def _truth(self, index: int) -> FloatArray | None:
        """Get a frame's true pose, None where it is not known."""
        poses = self.dataset.ground_truth
        if poses is None or not np.isfinite(poses[index]).all():
            return None
        return np.array(poses[index], dtype=np.float64)
