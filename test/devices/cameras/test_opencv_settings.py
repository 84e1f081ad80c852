# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of a USB camera are read back, against a stand-in for VideoCapture."""

import cv2
import pytest

from ivfmc_ros.devices.cameras import opencv
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.errors import CameraLostError


class Device:
    """Takes all settings but those in ``fixed``."""

    def __init__(self, fixed):
        self.fixed, self.values = fixed, {}

    def isOpened(self):  # noqa: N802, the name of OpenCV
        return True

    def set(self, key, value):
        self.values[key] = value
        return True

    def get(self, key):
        return self.fixed.get(key, self.values.get(key, 0.0))

    def release(self):
        pass


@pytest.fixture
def camera(monkeypatch):
    def make(fixed=None, **options):
        monkeypatch.setattr(cv2, 'VideoCapture', lambda source: Device(fixed or {}))
        return opencv.OpencvCamera('0', Exposure(), **options)

    return make


def test_camera_that_takes_all_has_no_warning(camera):
    device = camera(size=(640, 480), pixel_format='GREY', white_balance=4600)
    device.open()
    assert device.warning == ''


@pytest.mark.parametrize(
    ('fixed', 'said'),
    [
        ({cv2.CAP_PROP_EXPOSURE: 156.0}, 'exposure 50 was asked for, the camera has 156'),
        ({cv2.CAP_PROP_AUTO_EXPOSURE: 3.0}, 'automatic exposure'),
        ({cv2.CAP_PROP_AUTO_WB: 1.0}, 'automatic white balance'),
        ({cv2.CAP_PROP_GAIN: 64.0}, 'gain 1 was asked for, the camera has 64'),
    ],
)
def test_setting_that_is_not_taken_is_a_warning(camera, fixed, said):
    device = camera(fixed)
    device.open()
    assert said in device.warning


@pytest.mark.parametrize(
    ('fixed', 'options', 'said'),
    [
        ({cv2.CAP_PROP_FRAME_WIDTH: 320.0}, {'size': (640, 480)}, 'gives 320x480'),
        ({cv2.CAP_PROP_FOURCC: 1448695129.0}, {'pixel_format': 'GREY'}, 'gives YUYV'),
    ],
)
def test_size_or_format_that_is_not_taken_is_an_error(camera, fixed, options, said):
    with pytest.raises(CameraLostError, match=said):
        camera(fixed, **options).open()


def test_another_camera_at_the_same_number_is_refused(camera, tmp_path, monkeypatch):
    folder = tmp_path / 'video0' / 'device'
    folder.mkdir(parents=True)
    monkeypatch.setattr(opencv, '_SYSFS', tmp_path)
    (folder / 'serial').write_text('A1\n')
    device = camera()
    device.open()
    device.close()
    device.open()
    (folder / 'serial').write_text('B2\n')
    with pytest.raises(CameraLostError, match='serial number B2, it was A1'):
        device.open()
