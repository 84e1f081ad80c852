# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import subprocess
import sys
import time

import cv2
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image
from sensor_msgs.srv import SetCameraInfo
from support.graph_rig import node_environment
from support.graph_rig import running

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.simulation.bench import bench_camera
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.live.folder import LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live_cell import live_cell
from ivfmc_ros.simulation.render.optics import Optics


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / 'pictures'
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f'{number}.png'), np.full((48, 64), 10 * number, np.uint8))
    return folder


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / 'camera.yaml'
    save_camera(path, bench_camera())
    return path


def test_images_of_a_folder_are_published_with_a_stamp_each(client, pictures):
    with running('camera', backend='folder', folder=str(pictures), frame_rate=30.0):
        images = client.collect(Image, 'image_raw')
        infos = client.collect(CameraInfo, 'camera_info')
        client.until(lambda: len(images) > 10 and len(infos) > 10)
    values = [image.data[0] for image in images[:6]]
    assert set(values) == {0, 10, 20}
    stamps = [(image.header.stamp.sec, image.header.stamp.nanosec) for image in images]
    assert stamps == sorted(set(stamps))
    said = {(info.header.stamp.sec, info.header.stamp.nanosec) for info in infos}
    assert len(said.intersection(stamps)) > 8
    assert (images[0].width, images[0].height, images[0].encoding) == (64, 48, 'mono8')
    assert images[0].header.frame_id == 'camera_optical_frame'
    # uncalibrated: zeros, as in other drivers
    assert (infos[0].width, infos[0].k[0]) == (64, 0.0)


def test_calibration_of_another_image_size_is_reported_and_not_published(
    client, pictures, calibration
):
    parameters = {'folder': str(pictures), 'camera_info': str(calibration)}
    with running('camera', backend='folder', **parameters):
        infos = client.collect(CameraInfo, 'camera_info')
        client.until(lambda: 'calibrated' in client.diagnostic('camera'))
        assert infos == []


def test_simulated_camera_sees_the_live_cell(client, tmp_path):
    folder = tmp_path / 'live'
    words = [sys.executable, '-m', 'ivfmc_ros.simulation.live_cell', '--folder', str(folder)]
    process = subprocess.Popen(
        [*words, '--part', 'none'], env=node_environment(), stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == 'ready\n'
    parameters = {'simulation': str(folder), 'camera_info': str(folder / 'camera.yaml')}
    with running('camera', backend='simulated', **parameters):
        images = client.collect(Image, 'image_raw')
        infos = client.collect(CameraInfo, 'camera_info')
        # open3d takes seconds to load
        client.until(lambda: images and infos, 60.0)
        assert (images[0].width, images[0].height) == (1280, 1024)
        assert infos[0].k[0] == pytest.approx(2350.0)
        assert np.mean(images[0].data) == pytest.approx(6.0, abs=0.1)
        process.terminate()
        process.wait(timeout=5)
        client.until(lambda: 'ended' in client.diagnostic('camera'), 10.0)


def test_camera_without_images_is_said_within_two_seconds(client, pictures):
    with running('camera', backend='folder', folder=str(pictures), frame_rate=20.0):
        images = client.collect(Image, 'image_raw')
        client.until(lambda: len(images) > 5)
        # one long frame period, which begins with the next image
        assert client.set('camera', frame_rate=0.2).successful
        client.spin(0.2)
        assert client.set('camera', frame_rate=20.0).successful
        begin_s = time.monotonic() - 0.2
        client.until(lambda: 'delivers no images' in client.diagnostic('camera'), 3.0)
        assert time.monotonic() - begin_s < 2.0


def test_exposure_out_of_range_or_longer_than_the_period_is_rejected(client, pictures):
    with running('camera', backend='folder', folder=str(pictures)):
        for wrong in ({'exposure': 0.0}, {'exposure': float('nan')}, {'exposure': 0.5}):
            assert not client.set('camera', **wrong).successful
        answer = client.set('camera', exposure=0.5, frame_rate=1.0)
        assert answer.successful, answer.reason


def test_parameters_of_activation_are_rejected_while_active(client, pictures):
    # a device number is accepted as an integer
    with running('camera', backend='folder', folder=str(pictures), device=1):
        client.until(lambda: 'publishing images' in client.diagnostic('camera'))
        answer = client.set('camera', width=320)
        assert not answer.successful
        assert 'width: takes effect at activation' in answer.reason
        request = ChangeState.Request()
        request.transition.id = Transition.TRANSITION_DEACTIVATE
        assert client.call(ChangeState, 'camera/change_state', request).success
        assert client.set('camera', width=320).successful


def test_set_camera_info_is_saved(client, pictures, calibration):
    parameters = {'folder': str(pictures), 'camera_info': str(calibration)}
    with running('camera', backend='folder', **parameters):
        info = CameraInfo(width=64, height=48, distortion_model='plumb_bob', d=[0.0] * 5)
        info.k = [50.0, 0.0, 32.0, 0.0, 50.0, 24.0, 0.0, 0.0, 1.0]
        request = SetCameraInfo.Request(camera_info=info)
        answer = client.call(SetCameraInfo, 'camera/set_camera_info', request)
        assert answer.success, answer.status_message
        infos = client.collect(CameraInfo, 'camera_info')
        client.until(lambda: infos)
        assert infos[-1].k[0] == 50.0
        info.k = [0.0] * 9
        answer = client.call(SetCameraInfo, 'camera/set_camera_info', request)
        assert not answer.success
    assert load_camera(calibration).K[0, 0] == 50.0


def test_missing_folder_is_reported(client, tmp_path):
    with running('camera', backend='folder', folder=str(tmp_path / 'none')):
        client.until(lambda: 'none' in client.diagnostic('camera'))


def test_backend_without_its_location_is_reported(client):
    with running('camera', backend='simulated'):
        client.until(lambda: 'simulation: is required' in client.diagnostic('camera'))


def test_region_of_the_sensor_is_in_camera_info():
    from ivfmc_ros.cell.camera import Camera
    from ivfmc_ros.nodes.camera import camera_info
    from ivfmc_ros.nodes.camera import with_region
    from ivfmc_ros.storage.messages.camera_info import to_camera

    K = np.array([[1000.0, 0.0, 640.0], [0.0, 1000.0, 512.0], [0.0, 0.0, 1.0]])
    sensor = Camera(width=1280, height=1024, K=K, distortion=np.zeros(5))
    info = with_region(camera_info(sensor, 320, 256), sensor, (320, 256, 640, 512), 2)
    seen = to_camera(info, 'test')
    assert (seen.width, seen.height) == (320, 256)
    # the principal point is in the middle of the region
    assert seen.K[0, 2] == pytest.approx((640 - 320) / 2, abs=0.5)


def test_trigger_of_a_backend_without_a_line_is_reported(client, pictures):
    with running('camera', backend='folder', folder=str(pictures), trigger='Line1'):
        client.until(lambda: 'has no trigger line' in client.diagnostic('camera'))


def test_triggered_camera_waits_at_standstill_without_a_fault_and_runs_freely_after(
    client, tmp_path
):
    cell = bench_cell()
    table = replace(cell.turntable, trigger_step=0.02)
    description = LiveDescription(
        cell=replace(cell, turntable=table), solid=None, optics=Optics(), seed=0
    )
    folder = LiveFolder(tmp_path / 'live')
    with (
        live_cell(folder, description),
        running('camera', backend='simulated', simulation=str(folder.folder), trigger='table'),
    ):
        images = client.collect(Image, 'image_raw')
        # open3d takes seconds to load
        client.until(lambda: 'publishing images' in client.diagnostic('camera'), 60.0)
        client.spin(3.0)
        assert images == []
        assert 'delivers no images' not in client.diagnostic('camera')
        assert client.set('camera', triggered=False).successful
        client.until(lambda: images, 10.0, 'no image')
