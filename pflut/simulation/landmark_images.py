"""What a camera sees of landmarks, and what a matcher finds between such images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.simulation.landmark_kernels import expect, match, see
from pflut.simulation.landmarks import Landmarks

DETECTED = 0.6  # share of the visible landmarks that an image has as features
# with these, matches become fewer with the distance as in the rendered homes (sims/home_matches.py)
VIEW_SCALE = 0.3  # radians of view that divide the matches by e
DISTANCE_SCALE = 0.45  # of the logarithm of the distance, likewise
NEAR = 5.0  # metres: shares and numbers of matches are those with references as near as this


@dataclass(frozen=True, eq=False)
class LandmarkImages:
    """Images of landmarks, their features rather: the landmarks each shows, and where.

    Attributes
    ----------
    poses : ndarray of shape (m, 3)
        Where they were taken.
    seen : ndarray of shape (m, n) bool
        Which landmarks each shows. What follows holds there only.
    azimuth, elevation : ndarray of shape (m, n)
        Bearings in the robot's frame, radians.
    view : ndarray of shape (m, n)
        From which side a landmark's surface is seen, radians off its normal.
    log_distance : ndarray of shape (m, n)
        Logarithm of the distance in metres.
    """

    poses: FloatArray
    seen: NDArray[np.bool_]
    azimuth: FloatArray
    elevation: FloatArray
    view: FloatArray
    log_distance: FloatArray

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.poses)

    @classmethod
    def empty(cls, poses: FloatArray, landmarks: int) -> LandmarkImages:
        """Make images that show nothing yet."""
        shape = (len(poses), landmarks)
        return cls(poses, np.zeros(shape, bool), *(np.zeros(shape) for _ in range(4)))

    def take(
        self,
        i: int,
        landmarks: Landmarks,
        walls: FloatArray,
        people: FloatArray,
        *,
        noise: float,
        detected: float = DETECTED,
        rng: np.random.Generator,
    ) -> None:
        """Fill in an image.

        Parameters
        ----------
        i : int
            Which one.
        landmarks : Landmarks
            As they stand at that moment.
        walls : ndarray of shape (s, 2, 2)
            What hides landmarks, metres.
        people : ndarray of shape (k, 3)
            Who hides landmarks, metres and radians.
        noise : float
            Of bearings, radians, isotropic on the sphere.
        detected : float
            Share of the visible landmarks that the image shows.
        rng : Generator
        """
        see(
            self.poses[i],
            landmarks.points,
            landmarks.facing,
            walls,
            people,
            detected,
            noise,
            _state(rng),
            self.seen[i],
            self.azimuth[i],
            self.elevation[i],
            self.view[i],
            self.log_distance[i],
        )


@dataclass(frozen=True, eq=False)
class LandmarkMatcher:
    """Matches images of landmarks as descriptors would.

    A landmark of an image is matched with what looks most like it in the other: itself, or a copy
    that happens to be seen more alike. The more the view of a surface has turned, and the more its
    distance has changed, the less probable a match is; a runner-up that looks as much alike makes
    it fail, as in a ratio test. Besides there are mismatches of any features.

    Attributes
    ----------
    copies : ndarray of shape (n,) int
        Ring of the landmarks that look alike.
    gain : float
        Probability to match what looks the same in both images, in [0, 1].
    mismatches : float
        Mean number of other mismatches of a pair of images.
    """

    copies: NDArray[np.int64]
    gain: float
    mismatches: float

    def match(
        self, references: LandmarkImages, image: LandmarkImages, *, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Match an image with references.

        Parameters
        ----------
        references : LandmarkImages
            m images.
        image : LandmarkImages
            One.
        rng : Generator

        Returns
        -------
        counts : ndarray of shape (m,) int
            Matches of each reference.
        pairs : ndarray of shape (sum of counts, 2) int
            The landmark in the reference and the one in the image, one reference after the other.
        """
        shown = np.flatnonzero(image.seen[0])
        wrong = rng.poisson(self.mismatches, len(references))
        counts = np.empty(len(references), np.int64)
        pairs = np.empty((len(references) * len(shown) + int(wrong.sum()), 2), np.int64)
        match(
            references.seen,
            references.view,
            references.log_distance,
            shown,
            image.view[0],
            image.log_distance[0],
            self.copies,
            self.gain,
            VIEW_SCALE,
            DISTANCE_SCALE,
            wrong,
            _state(rng),
            counts,
            pairs,
        )
        return counts, pairs[: counts.sum()].copy()


def expected_matches(
    references: LandmarkImages, images: LandmarkImages, copies: NDArray[np.int64]
) -> FloatArray:
    """Count the matches of a pair within 5 m that a gain of 1 would give on the average.

    Parameters
    ----------
    references, images : LandmarkImages
    copies : ndarray of shape (n,) int

    Returns
    -------
    ndarray of shape (2,)
        Of landmarks with themselves, and with their copies.
    """
    total = np.zeros(2)
    pairs = 0
    for i in range(len(images)):
        offsets = references.poses[:, :2] - images.poses[i, :2]
        near = np.hypot(offsets[:, 0], offsets[:, 1]) < NEAR
        pairs += int(near.sum())
        expect(
            references.seen,
            references.view,
            references.log_distance,
            np.flatnonzero(images.seen[i]),
            images.view[i],
            images.log_distance[i],
            copies,
            VIEW_SCALE,
            DISTANCE_SCALE,
            near,
            total,
        )
    return total / max(pairs, 1)


def _state(rng: np.random.Generator) -> NDArray[np.uint64]:
    """Start the kernels' own stream of random numbers."""
    return rng.integers(2**64, size=1, dtype=np.uint64)
