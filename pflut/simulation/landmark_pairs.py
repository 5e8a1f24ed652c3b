"""Pairs of images from one drive through a home of landmarks: what maps are made of."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pflut.correspondences import Correspondences
from pflut.geometry import as_poses
from pflut.simulation.landmark_drive import LandmarkDrive
from pflut.simulation.landmark_images import LandmarkImages


def drive_pairs(
    drive: LandmarkDrive, poses: ArrayLike, *, rng: np.random.Generator | int | None = None
) -> tuple[NDArray[np.int64], list[Correspondences]]:
    """Take images along a path and match every two of them.

    Parameters
    ----------
    drive : LandmarkDrive
        Gives the home, its landmarks at rest, the noise and the matcher.
    poses : array_like of shape (n, 3)
        Where the images are taken: those of the drive, or of its home's mapping drive.
    rng : Generator, int or None
        Of the images and the matches.

    Returns
    -------
    indices : ndarray of shape (n (n - 1) / 2, 2)
        Of the images of each pair, the smaller one first: the view L.
    correspondences : list of Correspondences
        Of each pair.
    """
    generator = np.random.default_rng(rng)
    home = drive.home
    images = LandmarkImages.empty(as_poses(poses), len(drive.matcher.copies))
    nobody = np.empty((0, 3))
    for i in range(len(images)):
        noise = drive.scenario.noise
        images.take(i, home.landmarks, home.walls, nobody, noise=noise, rng=generator)
    indices, found = [], []
    for right in range(1, len(images)):
        earlier, image = _part(images, 0, right), _part(images, right, right + 1)
        counts, matches = drive.matcher.match(earlier, image, rng=generator)
        ends = np.cumsum(counts)
        for left in range(right):
            a, b = matches[ends[left] - counts[left] : ends[left]].T
            indices.append((left, right))
            found.append(
                Correspondences(
                    images.azimuth[left, a],
                    images.elevation[left, a],
                    images.azimuth[right, b],
                    images.elevation[right, b],
                )
            )
    return np.array(indices, dtype=np.int64).reshape(-1, 2), found


def _part(images: LandmarkImages, start: int, end: int) -> LandmarkImages:
    """Give some of the images."""
    return LandmarkImages(*(getattr(images, field.name)[start:end] for field in fields(images)))
