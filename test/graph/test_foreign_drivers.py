# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans with camera and table under drivers of other packages, as processes with their QoS."""

from contextlib import contextmanager
from contextlib import ExitStack
import os
from pathlib import Path
import signal
import subprocess
import sys

import numpy as np
import pytest
from support.foreign_axis import JOINT
from support.foreign_camera import DRIVERS
from support.foreign_camera import EXPOSURE_S
from support.foreign_camera import STAMP_DELAY_S
from support.graph_rig import node_environment
from support.graph_rig import running
from support.small_cell import small_cell

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.meshing.io.stl import read_stl
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.surface import Surface

STOPS = 24
NODES = ('triangulator', 'registrar', 'mesher', 'recorder')
# The remappings of joint_trajectory_controller.launch.xml.
TABLE = {'joint_trajectory': '/table_controller/joint_trajectory', 'joint_states': '/joint_states'}


@contextmanager
def process(module, *arguments, remappings=()):
    """A process of a stand-in that must still run at the end of the block."""
    words = [sys.executable, '-m', f'support.{module}', *map(str, arguments), '--ros-args']
    words += [word for before, after in remappings for word in ('-r', f'{before}:={after}')]
    found = subprocess.Popen(
        words, env=node_environment(), start_new_session=True, stdout=subprocess.PIPE, text=True
    )
    try:
        assert found.stdout.readline() == 'ready\n'
        yield
        assert found.poll() is None
    finally:
        found.send_signal(signal.SIGINT)
        try:
            found.wait(10.0)
        except subprocess.TimeoutExpired:
            os.killpg(found.pid, signal.SIGKILL)


@contextmanager
def cell(folder, driver):
    """Our nodes beside the drivers, as the launch files start them."""
    model = small_cell()
    files = folder / 'cell.yaml', folder / 'camera.yaml'
    save_cell(files[0], model)
    save_camera(files[1], model.camera)
    simulation, scans = folder / 'simulation', str(folder / 'scans')
    topics = zip(DRIVERS[driver].topics, ('image_raw', 'camera_info'), strict=True)
    calibration = {'cell': str(files[0])}
    stored = {**calibration, 'scan_root': scans}
    stamps = {'exposure': EXPOSURE_S, 'stamp_delay': STAMP_DELAY_S[driver]}
    lasers = {'port': str(simulation / 'controller'), 'table': False, 'lasers': ['left', 'right']}
    with ExitStack() as stack:
        enter = stack.enter_context
        enter(process('foreign_axis_node', simulation, *files))
        enter(process('foreign_camera_node', simulation, driver, remappings=topics))
        enter(running('turntable', laser_outputs=['spindle', 'coolant'], **lasers))
        enter(running('triangulator', TABLE, volume__bottom=0.0005, **calibration, **stamps))
        enter(running('registrar', TABLE, **stored))
        enter(running('mesher', TABLE, mesh__voxel=0.0006, **stored))
        enter(running('recorder', TABLE, scan_root=scans))
        enter(running('orchestrator', TABLE, joint=JOINT, **stored))
        yield


@pytest.mark.slow
@pytest.mark.parametrize('driver', ['usb_cam', 'v4l2_camera_sensor_data', 'camera_aravis2'])
def test_scan_has_the_right_shape(client, tmp_path, driver):
    client.status.clear()
    for node in NODES:
        client.forget(node)
    with cell(tmp_path, driver):
        # on a busy computer the nodes come up one after the other
        client.until(lambda: client.status and all(map(client.diagnostic, NODES)), 120.0)
        values = {'motion': 'step', 'profiles': STOPS, 'velocity': 3.0, 'profile_patience': 10.0}
        result = client.set('orchestrator', **values)
        assert result.successful, result.reason
        success, answer = client.trigger('scan', 240.0)
    assert success, answer
    assert answer['counts']['profiles'] == 2 * STOPS
    part = demo_part()
    vertices, _ = read_stl(Path(answer['files']['mesh.stl']))
    distance = Surface(part.vertices_xyz, part.faces).signed_distance(vertices)
    assert float(np.sqrt(np.median(distance**2))) < 2e-4
