"""All pairs of the images of a simulated drive."""

from __future__ import annotations

import numpy as np

from pflut.geometry import relative_headings
from pflut.likelihood.table import LikelihoodTable
from pflut.posterior import pose_posterior
from pflut.simulation.landmark_drive import simulate_drive
from pflut.simulation.landmark_pairs import drive_pairs


def test_every_two_images_once(default_table: LikelihoodTable) -> None:
    drive = simulate_drive("tracking", 0)
    poses = drive.ground_truth[:12]
    indices, found = drive_pairs(drive, poses, rng=3)
    assert len(indices) == len(found) == 66
    assert (indices[:, 0] < indices[:, 1]).all() and len(np.unique(indices, axis=0)) == 66
    again, same = drive_pairs(drive, poses, rng=3)
    np.testing.assert_array_equal(again, indices)
    np.testing.assert_array_equal(same[40].azimuth_r, found[40].azimuth_r)
    # L is the first image: the true headings are much more probable than exchanged ones
    scores = []
    for (left, right), matches in zip(indices, found, strict=True):
        theta, phi, distance = relative_headings(poses[left], poses[right])
        if 0.3 < distance < 1.5 and len(matches) > 10:
            posterior = pose_posterior(matches, default_table, bins=64)
            scores.append(posterior.log_density(theta, phi) - posterior.log_density(phi, theta))
    assert len(scores) > 10 and np.median(scores) > 5.0
