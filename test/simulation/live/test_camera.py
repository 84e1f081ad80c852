# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the simulated camera; its images are those of a scene that stands in."""

from types import SimpleNamespace

import numpy as np
import pytest

from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.simulation.live.camera import SimulatedCamera
from ivfmc_ros.simulation.live.folder import LiveFolder


@pytest.fixture
def camera(tmp_path):
    """A camera that is open."""
    camera = SimulatedCamera(tmp_path, Exposure(frame_rate=500.0, seconds=1e-4))
    LiveFolder(tmp_path).truth.touch()
    camera._truth = SimpleNamespace(
        table_state=lambda now: (0.0, 0.0),
        mean_laser_powers=lambda begin, end: np.zeros(2),
    )
    rng = np.random.default_rng(0)
    camera._scene = SimpleNamespace(
        render=lambda *_: rng.integers(0, 9, (4, 6)).astype(np.uint8),
    )
    return camera


def is_new(camera, before):
    return not np.array_equal(camera.grab(1.0).image, before.image)


def test_camera_freezes_until_the_fault_has_ended(camera, tmp_path):
    first = camera.grab(1.0)
    assert is_new(camera, first)
    last = camera.grab(1.0)
    fault = LiveFolder(tmp_path).camera_fault
    fault.write_text('freeze\n')
    frozen = camera.grab(1.0)
    assert np.array_equal(frozen.image, last.image)
    assert frozen.stamp_ns > last.stamp_ns
    fault.write_text('')
    assert is_new(camera, last)


def test_camera_that_is_unplugged_is_lost_and_cannot_be_opened(camera, tmp_path):
    LiveFolder(tmp_path).camera_fault.write_text('unplug')
    with pytest.raises(CameraLostError, match='unplugged'):
        camera.grab(1.0)
    with pytest.raises(CameraLostError, match='unplugged'):
        camera.open()
