"""Axes, handedness and pixels against the ground truth of real images, where they are there."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.correspondences import Correspondences
from pflut.datasets.base import Dataset
from pflut.datasets.registry import data_root, load_dataset
from pflut.features import FeatureExtractor, match
from pflut.geometry import relative_headings


def dataset(name: str) -> Dataset:
    root = data_root()
    if root is None or not (root / name).is_dir():
        pytest.skip(f"{name} is not there: set PFLUT_DATA")
    return load_dataset(root / name)


def share_near(
    matches: Correspondences, pose_l: np.ndarray, pose_r: np.ndarray, limit: float
) -> float:
    """Share of matches whose planar epipolar residual over its gradient is below the limit."""
    theta, phi, _ = relative_headings(pose_l, pose_r)
    a, b = theta - matches.azimuth_l, phi - matches.azimuth_r
    sl, cl = np.sin(matches.elevation_l), np.cos(matches.elevation_l)
    sr, cr = np.sin(matches.elevation_r), np.cos(matches.elevation_r)
    f = sr * cl * np.sin(a) + sl * cr * np.sin(b)
    gradient = [
        sr * np.cos(a),
        sl * np.cos(b),
        cl * cr * np.sin(b) - sr * sl * np.sin(a),
        cr * cl * np.sin(a) - sl * sr * np.sin(b),
    ]
    return float((np.abs(f) < limit * np.linalg.norm(gradient, axis=0)).mean())


@pytest.mark.parametrize(
    ("name", "pairs", "limit_deg", "share"),
    [
        ("zind_home000", [(0, 1), (1, 2), (0, 2)], 1.0, 0.35),
        ("kitti07_first160", [(0, 10), (120, 125)], 0.5, 0.85),
    ],
)
def test_matches_lie_on_the_epipolar_curve(
    name: str, pairs: list[tuple[int, int]], limit_deg: float, share: float
) -> None:
    data = dataset(name)
    assert data.ground_truth is not None
    extractor = FeatureExtractor(data.camera, mask_elevation=data.mask_elevation)
    features = {i: extractor(data.image(i)) for pair in pairs for i in pair}
    limit = np.deg2rad(limit_deg)
    shares, mirrored = [], []
    for i, j in pairs:
        matches = match(features[i], features[j])
        pose_l, pose_r = data.ground_truth[i], data.ground_truth[j]
        shares.append(share_near(matches, pose_l, pose_r, limit))
        # azimuths the wrong way around must not do as well
        wrong = Correspondences(
            -matches.azimuth_l, matches.elevation_l, -matches.azimuth_r, matches.elevation_r
        )
        mirrored.append(share_near(wrong, pose_l, pose_r, limit))
    assert np.mean(shares) > share
    assert np.mean(shares) > np.mean(mirrored) + 0.05
