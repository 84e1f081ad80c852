# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
import time

import cv2
import numpy as np
import pytest

from ivfmc_ros.devices.cameras import capture as capture_module
from ivfmc_ros.devices.cameras.capture import Capture
from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.cameras.folder import FolderCamera
from ivfmc_ros.devices.cameras.frame_timer import FrameTimer
from ivfmc_ros.devices.cameras.frame_watch import FrameWatch
from ivfmc_ros.devices.cameras.opencv import OpencvCamera
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import ParameterError


class FragileCamera:
    """Gives three pictures, then is unplugged."""

    def __init__(self):
        self.opened = self.closed = self.given = 0
        self.warning = ''

    def open(self):
        self.opened += 1
        self.given = 0

    def grab(self, timeout):
        if self.given == 3:
            raise CameraLostError('unplugged')
        self.given += 1
        return CameraImage(image=np.zeros((2, 2), np.uint8), stamp_ns=time.time_ns())

    def set_exposure(self, exposure):
        pass

    def close(self):
        self.closed += 1


def test_lost_camera_is_closed_and_opened_again():
    camera, pictures = FragileCamera(), []
    capture = Capture(camera, Exposure(), pictures.append)
    capture.start()
    deadline = time.monotonic() + 5.0
    while camera.opened < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    capture.stop()
    capture.stop()
    assert camera.opened == 2
    assert camera.closed == 2
    assert capture.image_count >= 3


@pytest.mark.parametrize('watched', [True, False])
def test_silent_camera_is_opened_again_but_a_folder_may_end(monkeypatch, watched):
    class SilentCamera(FragileCamera):
        def grab(self, timeout):
            time.sleep(0.01)

    monkeypatch.setattr(capture_module, '_REOPENED_AFTER', 0.1)
    monkeypatch.setattr(capture_module, '_RETRY_PERIOD', 0.01)
    camera = SilentCamera()
    capture = Capture(camera, Exposure(frame_rate=100.0), print, watched=watched)
    capture.start()
    deadline = time.monotonic() + (5.0 if watched else 0.5)
    while camera.opened < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    capture.stop()
    assert (camera.opened >= 3) == watched


def test_image_that_cannot_be_delivered_is_a_fault_and_capture_continues():
    camera, pictures = FragileCamera(), []

    def deliver(picture):
        if not pictures:
            pictures.append(picture)
            raise ValueError('no such encoding')
        pictures.append(picture)

    capture = Capture(camera, Exposure(), deliver)
    capture.start()
    deadline = time.monotonic() + 5.0
    while 'ValueError: no such encoding' not in capture.fault and time.monotonic() < deadline:
        time.sleep(0.01)
    assert time.monotonic() < deadline
    while len(pictures) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    capture.stop()
    assert len(pictures) >= 3


def test_frame_timer_keeps_the_rate_and_skips_missed_frames():
    now = [100.0]
    timer = FrameTimer(
        clock=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds)
    )
    moments = [timer.wait_next(0.1, 1.0) for _ in range(3)]
    assert moments == pytest.approx([100.0, 100.1, 100.2])
    now[0] += 0.55
    assert timer.wait_next(0.1, 1.0) == pytest.approx(100.75)
    assert timer.wait_next(0.1, 1.0) == pytest.approx(100.85)
    assert timer.wait_next(10.0, 0.0001) is None


def test_folder_ends_unless_it_repeats(tmp_path):
    cv2.imwrite(str(tmp_path / '1.png'), np.zeros((4, 4), np.uint8))
    camera = FolderCamera(tmp_path, Exposure(frame_rate=1000.0, seconds=1e-4), repeat=False)
    camera.open()
    assert camera.grab(0.5) is not None
    assert camera.grab(0.01) is None
    camera.close()


def test_folder_without_pictures_is_refused(tmp_path):
    with pytest.raises(CameraLostError, match='no picture'):
        FolderCamera(tmp_path, Exposure()).open()


def test_damaged_picture_is_a_lost_camera(tmp_path):
    (tmp_path / '1.png').write_bytes(b'\x89PNG\r\n\x1a\nnothing')
    camera = FolderCamera(tmp_path, Exposure())
    camera.open()
    with pytest.raises(CameraLostError):
        camera.grab(1.0)


def test_video_ends_as_a_lost_camera(tmp_path):
    path = tmp_path / 'video.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 10.0, (64, 48))
    if not writer.isOpened():
        pytest.skip('this OpenCV writes no video')
    for _ in range(3):
        writer.write(np.full((48, 64, 3), 100, np.uint8))
    writer.release()
    camera = OpencvCamera(str(path), Exposure(seconds=0.001), latency=0.01)
    camera.open()
    picture = camera.grab(0.1)
    assert picture is not None
    assert picture.image.shape == (48, 64)
    assert time.time_ns() - picture.stamp_ns >= 11_000_000
    with pytest.raises(CameraLostError, match='no images'):
        for _ in range(20):
            camera.grab(0.001)
    camera.close()


def test_missing_opencv_camera_is_refused(tmp_path):
    with pytest.raises(CameraLostError, match='cannot be opened'):
        OpencvCamera(str(tmp_path / 'none.avi'), Exposure()).open()


@pytest.mark.parametrize(
    'wrong',
    [
        {'frame_rate': 0.0},
        {'frame_rate': math.nan},
        {'seconds': 0.0},
        {'seconds': 0.1, 'frame_rate': 20.0},
        {'gain': 0.0},
    ],
)
def test_exposure_out_of_range_is_refused(wrong):
    with pytest.raises(ParameterError):
        Exposure(**wrong)


class SilentCamera(FragileCamera):
    """Opens and gives no image, as one whose trigger does not come."""

    def grab(self, timeout):
        time.sleep(0.01)


@pytest.mark.parametrize('triggered', [True, False])
def test_silence_is_a_fault_of_a_free_running_camera_only(monkeypatch, triggered):
    monkeypatch.setattr(capture_module, '_LOST_AFTER', 0.05)
    capture = Capture(SilentCamera(), Exposure(triggered=triggered), lambda picture: None)
    capture.start()
    deadline = time.monotonic() + 5.0
    wanted = '' if triggered else 'the camera delivers no images'
    while capture.fault != wanted and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.3)
    assert capture.fault == wanted
    capture.stop()


class RestfulCamera(FragileCamera):
    """Gives 50 images a second, and one while it rests."""

    def __init__(self):
        super().__init__()
        self.rests, self.seed = [], 0

    def grab(self, timeout):
        time.sleep(1.0 if self.rests and self.rests[-1] else 0.02)
        self.seed += 1
        image = np.random.default_rng(self.seed).integers(0, 9, (32, 32)).astype(np.uint8)
        return CameraImage(image=image, stamp_ns=time.time_ns())

    def rest(self, resting):
        self.rests.append(resting)


def until(condition):
    deadline = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_camera_rests_while_its_images_are_not_wanted_and_that_is_no_fault():
    camera, wanted = RestfulCamera(), [False]
    # slower than the camera: only a rest pauses for two of its periods, not a busy computer
    exposure = Exposure(frame_rate=2.0, seconds=0.001)
    capture = Capture(camera, exposure, lambda image: None, wanted=lambda: wanted[0])
    capture.start()
    until(lambda: capture.image_count > 2)
    assert camera.rests == [True]
    wanted[0] = True
    until(lambda: camera.rests == [True, False])
    count, begin = capture.image_count, time.monotonic()
    until(lambda: capture.image_count > count + 10)
    assert time.monotonic() - begin < 5.0
    capture.stop()
    assert capture.fault == ''
    assert capture.counts['missing'] == 0


def test_triggered_camera_does_not_rest():
    camera = RestfulCamera()
    capture = Capture(camera, Exposure(triggered=True), lambda image: None, wanted=lambda: False)
    capture.start()
    until(lambda: capture.image_count > 2)
    capture.stop()
    assert camera.rests == []


def test_resting_video_is_read_on_but_not_decoded(tmp_path):
    path = tmp_path / 'video.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 10.0, (64, 48))
    if not writer.isOpened():
        pytest.skip('this OpenCV writes no video')
    for number in range(4):
        writer.write(np.full((48, 64, 3), 60 * number, np.uint8))
    writer.release()
    camera = OpencvCamera(str(path), Exposure(seconds=0.001))
    camera.open()
    camera.rest(True)
    assert camera.grab(0.1).image.mean() == pytest.approx(0.0, abs=5.0)
    assert camera.grab(0.1) is None
    assert camera.grab(0.1) is None
    camera.rest(False)
    # none of those in between waits in a queue
    assert camera.grab(0.1).image.mean() == pytest.approx(180.0, abs=5.0)
    camera.close()


def test_pause_of_the_triggers_is_no_missing_image():
    watch = FrameWatch()
    for number, now in enumerate((0.0, 0.1, 9.0)):
        image = np.full((4, 4), number, np.uint8)
        picture = CameraImage(image=image, stamp_ns=time.time_ns())
        assert watch.accepts(picture, math.inf, now)
    assert watch.counts['missing'] == 0
