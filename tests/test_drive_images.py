"""The images of a drive: which, in what order, and with what odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pflut.datasets.folder import load_folder
from pflut.mapping.drive_images import choose_images, drive_images
from pflut.replay.options import ReplayOptions
from pflut.replay.prepare import prepare_dataset
from pflut.simulation.odometry import odometry_stream, simulate_odometry


def test_those_with_odometry_in_the_order_of_time(room_folder: Path) -> None:
    room = load_folder(room_folder).with_references([7, 2])
    odometry = np.array(room.ground_truth)
    odometry[3] = np.nan
    room = room.with_odometry(odometry)
    assert drive_images(room, "references").image_paths == (
        room.image_paths[2],
        room.image_paths[7],
    )
    everything = drive_images(room)
    assert room.image_paths[3] not in everything.image_paths
    assert len(everything) == len(room) - 1 and len(drive_images(room, max_images=4)) == 4
    np.testing.assert_array_equal(drive_images(room, max_images=3).odometry, odometry[:3])
    with pytest.raises(ValueError, match="expected 2 images with odometry, got 1"):
        drive_images(room, max_images=1)


def test_some_images_need_no_odometry(room_folder: Path) -> None:
    room = load_folder(room_folder).with_references([7, 2])
    assert choose_images(room).image_paths == room.image_paths
    chosen = choose_images(room, "references")
    assert chosen.image_paths == (room.image_paths[2], room.image_paths[7])
    np.testing.assert_array_equal(chosen.ground_truth, room.ground_truth[[2, 7]])
    others = choose_images(room, "queries", max_images=3)
    assert others.image_paths == tuple(room.image_paths[k] for k in (0, 1, 3))
    with pytest.raises(ValueError, match="expected 2 images, got 1"):
        choose_images(room, max_images=1)


def test_a_map_and_a_replay_simulate_the_same_noise(room_folder: Path) -> None:
    room = load_folder(room_folder)
    drive = drive_images(room, simulate=True, seed=5)
    expected = simulate_odometry(room.ground_truth, rng=odometry_stream(5))
    np.testing.assert_array_equal(drive.odometry, expected)
    options = ReplayOptions(seed=5)
    replayed = prepare_dataset(room, options, simulated_odometry=True).dataset.odometry
    variance = options.odometry_noise**2
    expected = simulate_odometry(
        room.ground_truth,
        rotation_noise_from_rotation=variance,
        translation_noise_from_translation=variance,
        scale=options.odometry_scale,
        heading_drift=options.odometry_drift,
        rng=odometry_stream(5),
    )
    np.testing.assert_array_equal(replayed, expected)
    assert (drive_images(room, simulate=True, seed=6).odometry != drive.odometry).any()
