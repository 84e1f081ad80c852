# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""GenICam cameras, against the fake camera that Aravis has inside."""

from contextlib import contextmanager
from contextlib import suppress
from dataclasses import replace
import shutil
import subprocess
import sys
import time

import pytest

from ivfmc_ros.devices.cameras.aravis import AravisCamera
from ivfmc_ros.devices.cameras.aravis import AravisSettings
from ivfmc_ros.devices.cameras.aravis import load_aravis
from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import ParameterError

# Where Debian has gi, which a virtual environment does not see by itself.
SYSTEM = '/usr/lib/python3/dist-packages'
# Of the GigE camera, and its settings.
SERIAL = 'IVFMC1'
FREE = Exposure(frame_rate=25.0)


@pytest.fixture(scope='module')
def aravis():
    sys.path.append(SYSTEM)
    try:
        library = load_aravis()
    except CameraLostError as error:
        pytest.skip(str(error))
    finally:
        sys.path.remove(SYSTEM)
    library.enable_interface('Fake')
    return library


@pytest.fixture
def camera(aravis):
    opened = []

    def make(exposure=Exposure(frame_rate=25.0), **settings):  # noqa: B008, frozen
        camera = AravisCamera(AravisSettings(device='Fake_1', **settings), exposure)
        camera.open()
        opened.append(camera)
        return camera

    yield make
    for camera in opened:
        camera.close()


def grab(camera):
    for _ in range(20):
        if (picture := camera.grab(0.5)) is not None:
            return picture
    pytest.fail('no picture')


def test_images_have_region_rate_and_stamps_of_ros_time(camera):
    device = camera(region=(0, 0, 256, 128))
    pictures = [grab(device) for _ in range(6)]
    assert {picture.image.shape for picture in pictures} == {(128, 256)}
    stamps = [picture.stamp_ns for picture in pictures]
    assert stamps == sorted(stamps)
    assert abs(time.time_ns() - stamps[-1]) < 1e9
    assert 0.1 < (stamps[-1] - stamps[0]) * 1e-9 < 2.0


def test_settings_are_read_back(camera):
    device = camera(exposure=Exposure(frame_rate=20.0, seconds=0.002, gain=2.0))
    assert 'exposure 2000' not in device.warning
    device.set_exposure(Exposure(frame_rate=20.0, seconds=0.004))
    grab(device)
    assert device._camera.get_exposure_time() == pytest.approx(4000.0)


def test_region_that_the_camera_does_not_take_is_an_error(camera, aravis, monkeypatch):
    monkeypatch.setattr(aravis.Camera, 'get_region', lambda self: (0, 0, 640, 128))
    with pytest.raises(CameraLostError, match='region'):
        camera(region=(0, 0, 639, 128))


def test_another_serial_number_is_refused(camera):
    device = camera()
    device.close()
    device._serial = 'another'
    with pytest.raises(CameraLostError, match='it was another'):
        device.open()


def test_missing_camera_is_refused(aravis):
    camera = AravisCamera(AravisSettings(device='None_1'), Exposure())
    with pytest.raises(CameraLostError, match='cannot be opened'):
        camera.open()


def test_unknown_pixel_format_is_refused():
    with pytest.raises(ParameterError, match='Mono8'):
        AravisSettings(pixel_format='BayerRG8')


def test_missing_library_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'gi', None)
    with pytest.raises(CameraLostError, match=r'gir1\.2-aravis-0\.8'):
        load_aravis()


class TriggeredCamera:
    """What is called of a camera of Aravis to switch its trigger."""

    def __init__(self, *, locked=False):
        self.calls, self.locked = [], locked

    def set_trigger(self, line):
        if self.locked:
            raise RuntimeError('TriggerMode is not writable')
        self.calls.append(f'trigger {line}')

    def clear_triggers(self):
        self.calls.append('free')

    def stop_acquisition(self):
        self.calls.append('stop')

    def start_acquisition(self):
        self.calls.append('start')


def switched(*exposures, **camera):
    device = AravisCamera(AravisSettings(trigger='Line1'), Exposure())
    device._camera = TriggeredCamera(**camera)
    for triggered in exposures:
        device.set_exposure(Exposure(triggered=triggered))
        device._switch_trigger()
    return device._camera.calls


def test_trigger_is_switched_between_acquisitions_and_only_when_it_changes():
    calls = switched(False, True, True, False)
    assert calls == ['stop', 'trigger Line1', 'start', 'stop', 'free', 'start']


def test_camera_that_refuses_the_trigger_is_an_error():
    with pytest.raises(CameraLostError, match='trigger Line1: TriggerMode is not writable'):
        switched(True, locked=True)


@contextmanager
def gige_camera():
    """A GigE Vision camera on the loopback: a process of Aravis."""
    program = shutil.which('arv-fake-gv-camera-0.8')
    if program is None:
        pytest.skip('needs the fake camera of Aravis: apt-get install aravis-tools')
    process = subprocess.Popen([program, '-i', '127.0.0.1', '-s', SERIAL])
    # a look that finds it while it starts may take it for one on another network
    time.sleep(1.0)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def opened(aravis, **settings):
    """A camera of the process, which is found within seconds."""
    # whole images lose packets on a busy computer
    values = {'device': f'Aravis-Fake-{SERIAL}', 'region': (0, 0, 256, 128), **settings}
    camera = AravisCamera(AravisSettings(**values), FREE)
    open_patiently(camera)
    return camera


def open_patiently(camera):
    """Open a camera whose process has just been started."""
    for _ in range(20):
        with suppress(CameraLostError):
            return camera.open()
        time.sleep(0.2)
    return camera.open()


def images_within(camera, seconds):
    end = time.monotonic() + seconds
    count = 0
    while time.monotonic() < end:
        count += camera.grab(0.1) is not None
    return count


def test_gige_camera_waits_for_triggers_while_it_is_told_to(aravis):
    with gige_camera():
        camera = opened(aravis, trigger='Software')
        assert images_within(camera, 1.0) > 5
        camera.set_exposure(replace(FREE, triggered=True))
        images_within(camera, 0.5)
        assert images_within(camera, 1.0) == 0
        camera.set_exposure(FREE)
        images_within(camera, 0.5)
        assert images_within(camera, 1.0) > 5
        camera.close()


def test_gige_camera_that_is_gone_is_lost_and_comes_back(aravis):
    with gige_camera() as process:
        camera = opened(aravis)
        grab(camera)
        process.kill()
        process.wait()
        # Aravis gives up after some attempts of a second each
        with pytest.raises(CameraLostError, match='does not answer'):
            images_within(camera, 15.0)
        camera.close()
    with gige_camera():
        open_patiently(camera)
        grab(camera)
        camera.close()
