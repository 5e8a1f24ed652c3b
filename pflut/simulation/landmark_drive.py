"""Simulated drives whose observations are matches of landmarks: thousands in minutes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pflut.correspondences import Correspondences, ReferenceMatch
from pflut.geometry import FloatArray, compose, relative_pose
from pflut.simulation.crowd import Crowd
from pflut.simulation.drive import apart
from pflut.simulation.home import check_seed
from pflut.simulation.landmark_home import LandmarkHome, Plan, landmark_home
from pflut.simulation.landmark_images import LandmarkImages, LandmarkMatcher, expected_matches
from pflut.simulation.odometry import simulate_odometry
from pflut.simulation.scenarios import SCENARIOS, Scenario

SHORT_LIST = 32  # an observation has so many references, as many as the sensor model would match
HOMES = 20  # without a choice of one's own the seeds share so many homes
PROBES = 8  # drives that tell how many matches a home gives
CARRIED = 3.0  # metres that a kidnapped robot is carried at least
CARRYING = 10.0  # seconds that it takes
ODOMETRY_NOISE = {  # the variances of simulate_odometry
    "rotation_noise_from_rotation": 0.0025,
    "rotation_noise_from_translation": 0.0004,
    "translation_noise_from_translation": 0.0009,
    "translation_noise_from_rotation": 0.0001,
}


@dataclass(frozen=True, eq=False)
class LandmarkDrive:
    """A simulated drive: a `Localizer` takes it, with ``observations=drive.observation``.

    Attributes
    ----------
    scenario : Scenario
    seed : int
    home : LandmarkHome
    stamps : ndarray of shape (n,)
        Seconds.
    ground_truth : ndarray of shape (n, 3)
        True ``[x, y, heading]`` in the home's frame.
    odometry : ndarray of shape (n, 3)
        In a frame that starts at the first pose.
    kidnapped_at : int or None
        The first image after the robot was carried elsewhere.
    references : LandmarkImages
        The m reference images.
    matcher : LandmarkMatcher
    crowd : Crowd
        Who walks about during the drive.
    """

    scenario: Scenario
    seed: int
    home: LandmarkHome
    stamps: FloatArray
    ground_truth: FloatArray
    odometry: FloatArray
    kidnapped_at: int | None
    references: LandmarkImages
    matcher: LandmarkMatcher
    crowd: Crowd

    @property
    def name(self) -> str:
        """Of the scenario, the home and the drive."""
        return f"{self.scenario.name}, home {self.home.seed}, drive {self.seed}"

    @property
    def reference_poses(self) -> FloatArray:
        """Where the references were taken, shape (m, 3)."""
        return self.references.poses

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The home's (xmin, ymin, xmax, ymax) in metres."""
        return self.home.bounds

    @property
    def query_indices(self) -> NDArray[np.intp]:
        """All images of the drive."""
        return np.arange(len(self.stamps), dtype=np.intp)

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.stamps)

    def odometry_between(self, i: int, j: int, /) -> FloatArray:
        """Give the measured motion from image i to image j in the robot's frame at i."""
        return relative_pose(self.odometry[i], self.odometry[j])

    def image(self, i: int, /) -> NDArray[np.uint8]:
        """Refuse: there are no pictures.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError(
            f"image {i}: a simulated drive has matches only, expected its observation({i})"
        )

    def view(self, i: int) -> LandmarkImages:
        """Take an image: the landmarks that it shows.

        Parameters
        ----------
        i : int

        Returns
        -------
        LandmarkImages
            Of one image.

        Raises
        ------
        ValueError
            If there is no such image.
        """
        if not 0 <= i < len(self):
            raise ValueError(f"image: expected 0 to {len(self) - 1}, got {i}")
        taken = LandmarkImages.empty(self.ground_truth[i : i + 1], len(self.matcher.copies))
        _take(
            taken, 0, float(self.stamps[i]), self.home, self.crowd, self.scenario, self._rng(i, 0)
        )
        return taken

    def matches(self, i: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Match an image, and tell the landmarks: a true match is of one with itself, at rest.

        Parameters
        ----------
        i : int

        Returns
        -------
        counts : ndarray of shape (m,) int
            Matches of each reference.
        pairs : ndarray of shape (sum of counts, 2) int
            The landmark in the reference and the one in the image, one reference after the other;
            numbers from ``len(home.landmarks)`` on are people's.

        Raises
        ------
        ValueError
            If there is no such image.
        """
        return self.matcher.match(self.references, self.view(i), rng=self._rng(i, 1))

    def observation(self, i: int) -> list[ReferenceMatch]:
        """Match an image with the references: what `ReferenceImageModel` takes.

        Parameters
        ----------
        i : int

        Returns
        -------
        list of ReferenceMatch
            Of the 32 references with the most matches. The same at every call.

        Raises
        ------
        ValueError
            If there is no such image.
        """
        image = self.view(i)
        counts, pairs = self.matcher.match(self.references, image, rng=self._rng(i, 1))
        most = np.argsort(-counts, kind="stable")[:SHORT_LIST]
        ends = np.cumsum(counts)
        return [
            ReferenceMatch(
                index, self._seen(image, index, pairs[ends[index] - counts[index] : ends[index]])
            )
            for index in np.sort(most[counts[most] > 0]).tolist()
        ]

    def correspondences(self, i: int) -> list[Correspondences]:
        """Match an image with every reference.

        Parameters
        ----------
        i : int

        Returns
        -------
        list of m Correspondences
            L is the reference, R the image; some may be empty. The same at every call.

        Raises
        ------
        ValueError
            If there is no such image.
        """
        image = self.view(i)
        counts, pairs = self.matcher.match(self.references, image, rng=self._rng(i, 1))
        parts = np.split(pairs, np.cumsum(counts)[:-1])
        return [self._seen(image, index, part) for index, part in enumerate(parts)]

    def _seen(self, image: LandmarkImages, index: int, pairs: NDArray[np.int64]) -> Correspondences:
        """Give the bearings of matched landmarks in a reference and in an image."""
        left, right = pairs.T
        return Correspondences(
            self.references.azimuth[index, left],
            self.references.elevation[index, left],
            image.azimuth[0, right],
            image.elevation[0, right],
        )

    def _rng(self, i: int, purpose: int) -> np.random.Generator:
        """Give an image's own random numbers."""
        return np.random.default_rng([self.home.seed, self.seed, 32, i, purpose])


def simulate_drive(
    scenario: Scenario | str, seed: int = 0, *, home_seed: int | None = None
) -> LandmarkDrive:
    """Simulate a drive.

    Parameters
    ----------
    scenario : Scenario or str
        Or the name of one of `SCENARIOS`.
    seed : int
        Of the drive, its odometry and its images; not negative. Scenarios with the same seed have
        the same path where they can.
    home_seed : int, optional
        Of the home and its reference images. By default the drives take twenty homes in turn.

    Returns
    -------
    LandmarkDrive
        The same at every call.

    Raises
    ------
    ValueError
        If there is no such scenario, a seed is negative, or the home has not landmarks enough for
        so many true matches.
    """
    chosen = scenario_named(scenario)
    check_seed(seed, "seed")
    home = landmark_home(chosen.plan, seed % HOMES if home_seed is None else home_seed)
    stamps, poses, kidnapped_at = _path(home, chosen, np.random.default_rng([home.seed, seed, 11]))
    return LandmarkDrive(
        chosen,
        seed,
        home,
        stamps,
        poses,
        _odometry(chosen, poses, kidnapped_at, np.random.default_rng([home.seed, seed, 14])),
        kidnapped_at,
        *_map(chosen, home),
        _crowd(chosen, home, np.random.default_rng([home.seed, seed, 13])),
    )


def scenario_named(scenario: Scenario | str) -> Scenario:
    """Give a scenario by its name.

    Parameters
    ----------
    scenario : Scenario or str
        A scenario is handed back.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        If there is none of this name.
    """
    if isinstance(scenario, Scenario):
        return scenario
    if scenario not in SCENARIOS:
        raise ValueError(f"scenario: expected one of {', '.join(SCENARIOS)}, got {scenario!r}")
    return SCENARIOS[scenario]


def _take(
    images: LandmarkImages,
    i: int,
    stamp: float,
    home: LandmarkHome,
    crowd: Crowd,
    scenario: Scenario,
    rng: np.random.Generator,
) -> None:
    """Take an image of a home and the people in it."""
    people = crowd.poses(stamp, images.poses[i])
    landmarks = crowd.among(home.landmarks, people)
    images.take(i, landmarks, home.walls, people, noise=scenario.noise, rng=rng)


def _crowd(scenario: Scenario, home: LandmarkHome, rng: np.random.Generator) -> Crowd:
    """Send the same people on their way, to another place each day."""
    crowd = Crowd.gather(home.mapping.path, scenario.people, np.random.default_rng([home.seed, 33]))
    return Crowd(crowd.path, rng.uniform(0.0, crowd.path.stamps[-1], len(crowd)), crowd.patterns)


@lru_cache(maxsize=16)
def _map(scenario: Scenario, home: LandmarkHome) -> tuple[LandmarkImages, LandmarkMatcher]:
    """Take a home's reference images, and find the matcher that gives the scenario's matches."""
    crowd = _crowd(scenario, home, np.random.default_rng([home.seed, 34]))
    moments = _apart(home.mapping.path.poses, scenario.reference_spacing)
    everything = crowd.among(home.landmarks, np.zeros((len(crowd), 3)))
    references = LandmarkImages.empty(home.mapping.path.poses[moments], len(everything))
    for k, moment in enumerate(moments):
        stamp = float(home.mapping.path.stamps[moment])
        _take(
            references, k, stamp, home, crowd, scenario, np.random.default_rng([home.seed, 35, k])
        )
    true, copied = _matches_at_gain_one(home.plan, home.seed)
    wanted = scenario.matches * scenario.true_share
    if wanted > true:
        raise ValueError(
            f"matches: expected at most {true / scenario.true_share:.0f} a reference with a true "
            f"share of {scenario.true_share}, got {scenario.matches}"
        )
    gain = wanted / true
    mismatches = max(scenario.matches - wanted - gain * copied, 0.0)
    return references, LandmarkMatcher(everything.copies, gain, mismatches)


@lru_cache(maxsize=64)
def _matches_at_gain_one(plan: Plan, seed: int) -> tuple[float, float]:
    """Measure on drives of their own how many true matches a home gives, and of copies."""
    home = landmark_home(plan, seed)
    drives = [home.plan_drive(rng=np.random.default_rng([seed, 36, k])) for k in range(PROBES)]
    rng = np.random.default_rng([seed, 37])

    def taken(poses: FloatArray) -> LandmarkImages:
        images = LandmarkImages.empty(poses, len(home.landmarks))
        for i in range(len(images)):
            images.take(i, home.landmarks, home.walls, np.empty((0, 3)), noise=0.0, rng=rng)
        return images

    path = home.mapping.path.poses
    references = taken(path[_apart(path, 0.6)])
    images = taken(np.concatenate([drive.poses[::2] for drive in drives]))
    true, copied = expected_matches(references, images, home.landmarks.copies)
    return float(true), float(copied)


def _apart(path: FloatArray, spacing: float) -> list[int]:
    """Choose points of a path, of which every fifth is looked at, so far from each other."""
    looked_at = [0, *range(1, len(path), 5)]
    return [looked_at[row] for row in apart(path[looked_at], spacing)]


def _path(
    home: LandmarkHome, scenario: Scenario, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, int | None]:
    """Plan a drive, and another that goes on elsewhere where the robot is kidnapped."""
    drive = home.plan_drive(rng=rng)
    if not scenario.kidnapped:
        return drive.stamps, drive.poses, None
    k = len(drive.images) // 2 + int(rng.integers(-5, 6))
    rest = len(drive.images) - k
    while True:
        other = home.plan_drive(rng=rng)
        if len(other.images) >= rest:
            start = int(rng.integers(len(other.images) - rest + 1))
            poses = other.poses[start : start + rest]
            if np.hypot(*(poses[0] - drive.poses[k - 1])[:2]) >= CARRIED:
                break
    later = other.stamps[start : start + rest] - other.stamps[start]
    stamps = np.concatenate([drive.stamps[:k], drive.stamps[k - 1] + CARRYING + later])
    return stamps, np.concatenate([drive.poses[:k], poses]), k


def _odometry(
    scenario: Scenario, poses: FloatArray, kidnapped_at: int | None, rng: np.random.Generator
) -> FloatArray:
    """Measure a drive by wheels, which do not turn while the robot is carried."""
    driven = poses
    if kidnapped_at is not None:
        k = kidnapped_at
        rest = compose(poses[k - 1], relative_pose(poses[k], poses[k:]))
        driven = np.concatenate([poses[:k], rest])
    noise = {name: scenario.odometry_noise**2 * v for name, v in ODOMETRY_NOISE.items()}
    return simulate_odometry(
        driven,
        scale=scenario.odometry_scale,
        heading_drift=scenario.odometry_drift,
        rng=rng,
        **noise,
    )
