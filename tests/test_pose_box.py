"""The box around particles, and the windows of grids that it opens."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.geometry import TWO_PI, relative_headings, wrap_to_pi
from pflut.localization.pose_box import PoseBox


@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 1000])
def test_bounds(n: int) -> None:
    poses = np.random.default_rng(n).normal([1.0, -2.0, np.pi], [0.3, 2.0, 0.2], (n, 3))
    poses[:, 2] = wrap_to_pi(poses[:, 2])
    box = PoseBox.around(poses)
    assert box.bounds[:2, 0] == pytest.approx(poses[:, :2].min(axis=0))
    assert box.bounds[:2, 1] == pytest.approx(poses[:, :2].max(axis=0))
    turned = poses[0, 2] + np.asarray(wrap_to_pi(poses[:, 2] - poses[0, 2]))
    assert box.bounds[2] == pytest.approx([turned.min(), turned.max()])


def test_distances() -> None:
    box = PoseBox(np.array([[0.0, 2.0], [0.0, 1.0], [0.0, 0.0]]))
    points = np.array([[1.0, 0.5], [3.0, 0.5], [1.0, -2.0], [5.0, 5.0], [2.0, 1.0]])
    assert box.distances(points) == pytest.approx([0.0, 1.0, 2.0, 5.0, 0.0])


@pytest.mark.parametrize("bins", [16, 63, 192])
@pytest.mark.parametrize("spread", [1e-6, 0.05, 0.5, 5.0])
def test_windows_hold_every_corner_of_every_particles_cell(bins: int, spread: float) -> None:
    rng = np.random.default_rng(0)
    narrow = 0
    for _ in range(40):
        center = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi])
        poses = rng.normal(center, [spread, spread, 0.3 * spread], (50, 3))
        references = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi], (20, 3))
        windows = PoseBox.around(poses).windows(references, bins)
        assert ((windows[..., 0] >= 0) & (windows[..., 0] < bins)).all()
        assert ((windows[..., 1] > 0) & (windows[..., 1] <= bins)).all()
        narrow += int((windows[..., 1] < bins).sum())
        for reference, window in zip(references, windows, strict=True):
            theta, phi, _ = relative_headings(reference, poses)
            for angle, (first, count) in zip((theta, phi), window, strict=True):
                cell = np.floor(angle * bins / TWO_PI - 0.5).astype(int)
                for corner in (cell, cell + 1):
                    assert ((corner - first) % bins < count).all()
    # they are worth it where the particles stand together
    assert narrow > (0.9 * 40 * 40 if spread < 0.1 and bins > 16 else 0)
