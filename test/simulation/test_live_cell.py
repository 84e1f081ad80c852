# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ivfmc_ros.devices.cameras.device import Exposure
from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.errors import CameraLostError
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.live.camera import LiveScene
from ivfmc_ros.simulation.live.camera import SimulatedCamera
from ivfmc_ros.simulation.live.folder import LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthReader
from ivfmc_ros.simulation.live.truth import TruthWriter
from ivfmc_ros.simulation.live_cell import live_cell
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import StripeRenderer


@pytest.fixture
def description():
    return LiveDescription(
        cell=bench_cell(), solid=box((0.03, 0.03, 0.04)), optics=Optics(), seed=3
    )


def test_truth_is_read_as_it_was_written(tmp_path):
    writer = TruthWriter(tmp_path / 'truth')
    reader = TruthReader(tmp_path / 'truth')
    now = time.monotonic()
    motion = trajectory.trapezoid(0.0, 2.0, 1.0, 4.0, now + 1.0)
    writer.write_motion(now, motion)
    for time_s in np.linspace(now, now + 5.0, 50):
        assert reader.table_state(time_s) == pytest.approx(trajectory.state_at(motion, time_s))
    held = trajectory.brake(motion, 4.0, now + 1.5)
    writer.write_motion(now + 1.5, held)
    assert reader.table_state(now + 1.4) == pytest.approx(trajectory.state_at(motion, now + 1.4))
    assert reader.table_state(now + 4.0) == pytest.approx((held[-1].position, 0.0))


def test_laser_power_is_the_mean_over_the_exposure(tmp_path):
    writer = TruthWriter(tmp_path / 'truth')
    reader = TruthReader(tmp_path / 'truth')
    writer.write_lasers(10.0, (0.5, 0.0))
    writer.write_lasers(11.0, (0.0, 1.0))
    assert reader.mean_laser_powers(9.0, 9.5).tolist() == [0.0, 0.0]
    assert reader.mean_laser_powers(10.2, 10.8) == pytest.approx([0.5, 0.0])
    assert reader.mean_laser_powers(10.5, 11.5) == pytest.approx([0.25, 0.5])
    assert reader.mean_laser_powers(20.0, 21.0) == pytest.approx([0.0, 1.0])


def test_full_truth_file_overwrites_the_oldest_records(tmp_path):
    writer = TruthWriter(tmp_path / 'truth')
    reader = TruthReader(tmp_path / 'truth')
    for number in range(5000):
        writer.write_lasers(10.0 + number, (float(number), 0.0))
    assert reader.mean_laser_powers(5009.1, 5009.2)[0] == pytest.approx(4999.0)


@pytest.mark.parametrize('content', [b'', b'\0' * 393280])
def test_file_of_another_format_is_refused(tmp_path, content):
    (tmp_path / 'truth').write_bytes(content)
    with pytest.raises(FileError):
        TruthReader(tmp_path / 'truth')


def test_live_image_equals_the_rendered_one(tmp_path, description):
    folder = LiveFolder(tmp_path)
    folder.write(description)
    scene = LiveScene(folder)
    light = StripeRenderer(cell=description.cell, solid=description.solid).light(0.3, 1)
    image = scene.render(0.3, np.array([0.0, 1.0])).astype(np.float64)
    lit, dark = light > 20, light == 0
    expected = np.clip(light[lit] + 6.0, 0, 255)
    assert image[lit].mean() == pytest.approx(expected.mean(), rel=0.02)
    # speckle of 0.15, read and shot noise; clipping takes a little away
    noise = (image[lit] - expected) / light[lit]
    assert noise.std() == pytest.approx(0.15, abs=0.03)
    assert image[dark].mean() == pytest.approx(6.0, abs=0.05)
    assert image[dark].std() == pytest.approx(math.hypot(2.03, 0.29), abs=0.05)


def test_dark_image_is_fast_and_has_new_noise(tmp_path, description):
    folder = LiveFolder(tmp_path)
    folder.write(description)
    scene = LiveScene(folder)
    first = scene.render(0.0, np.zeros(2))
    start = time.process_time()
    second = scene.render(0.0, np.zeros(2))
    assert time.process_time() - start < 0.015
    assert (first != second).mean() > 0.5


def test_camera_sees_the_laser_that_the_controller_turned_on(tmp_path, description):
    with live_cell(LiveFolder(tmp_path / 'cell'), description):
        controller = GrblController(
            ControllerSettings(
                port=str(tmp_path / 'cell' / 'controller'), lasers={'a': 'spindle', 'b': 'coolant'}
            )
        )
        controller.open()
        camera = SimulatedCamera(tmp_path / 'cell', Exposure(frame_rate=100.0, seconds=0.002))
        camera.open()
        camera.set_exposure(Exposure(frame_rate=100.0, seconds=0.005))
        peaks = []
        for laser in (None, 'a', 'b', None):
            controller.set_laser(laser)
            peaks.append(int(camera.grab(1.0).image.max()))
        controller.close()
        assert max(peaks[0], peaks[3]) < 30
        assert min(peaks[1:3]) > 100
        camera.close()
        with pytest.raises(CameraLostError, match='not open'):
            camera.grab(0.1)
    assert list((tmp_path / 'cell').iterdir()) == []


def test_camera_exposes_on_the_pulses_of_the_axis(tmp_path, description):
    step = math.radians(2.0)
    cell = description.cell
    cell = replace(cell, turntable=replace(cell.turntable, trigger_step=step))
    folder = LiveFolder(tmp_path / 'cell')
    with live_cell(folder, replace(description, cell=cell)) as emulator:
        exposure = Exposure(frame_rate=50.0, seconds=0.002, triggered=True)
        camera = SimulatedCamera(folder.folder, exposure)
        camera.open()
        assert camera.grab(0.1) is None, 'the axis stands'
        controller = GrblController(ControllerSettings(port=str(folder.controller), lasers={}))
        controller.open()
        truth = TruthReader(folder.truth)
        offset = time.time() - time.monotonic()
        angles = []
        for drop in (0.0, 1.0):
            emulator.fault(f'trigger drop {drop}')
            target = math.radians(31.0) * (1.0 + drop)
            controller.move_to(target, 0.3, 4.0)
            deadline = time.monotonic() + 20.0
            while truth.table_state(time.monotonic())[0] < target - 1e-3:
                assert time.monotonic() < deadline
                picture = camera.grab(0.1)
                if picture is not None:
                    angles.append(truth.table_state(picture.stamp_ns * 1e-9 - offset)[0])
        controller.close()
        camera.close()
        with pytest.raises(ValueError, match='trigger'):
            emulator.fault('trigger triple 0.5')
    # a computer that is busy may be too late for some
    numbers = np.array(angles) / step
    assert len(numbers) >= 3
    assert numbers.max() < 16.0
    np.testing.assert_allclose(numbers, np.round(numbers), atol=0.01)


def test_cell_without_a_trigger_line_has_no_fault_of_it(tmp_path, description):
    with (
        live_cell(LiveFolder(tmp_path / 'cell'), description) as emulator,
        pytest.raises(ValueError, match='no trigger line'),
    ):
        emulator.fault('trigger drop 0.5')


def test_folder_without_a_cell_is_refused(tmp_path):
    with pytest.raises(CameraLostError, match='is the simulated cell running'):
        SimulatedCamera(tmp_path, Exposure()).open()


def test_second_cell_in_a_folder_is_refused(tmp_path, description):
    with (
        live_cell(LiveFolder(tmp_path), description),
        pytest.raises(FileError, match='another process'),
        live_cell(LiveFolder(tmp_path), description),
    ):
        pass


def test_process_reports_ready_accepts_faults_and_removes_its_files(tmp_path):
    words = [sys.executable, '-m', 'ivfmc_ros.simulation.live_cell', '--folder', str(tmp_path)]
    process = subprocess.Popen(
        [*words, '--part', 'none'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    assert process.stdout.readline() == 'ready\n'
    (tmp_path / 'faults').write_text('nonsense\n')
    assert 'no fault' in process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=5) == 0
    assert list(tmp_path.iterdir()) == []


def test_process_refuses_a_missing_part_file(tmp_path):
    words = [sys.executable, '-m', 'ivfmc_ros.simulation.live_cell', '--folder', str(tmp_path)]
    done = subprocess.run(
        [*words, '--part', str(tmp_path / 'none.stl')],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    assert done.returncode == 1
    assert 'there is no such file' in done.stderr
