# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from xml.etree import ElementTree

import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.urdf import roll_pitch_yaw
from ivfmc_ros.cell.urdf import urdf
from ivfmc_ros.cell.urdf import write_urdf
from ivfmc_ros.errors import CellError
from ivfmc_ros.simulation.bench import bench_cell


def matrix(roll, pitch, yaw):
    """Rotation of URDF's roll, pitch, yaw, by its definition."""
    cx, sx, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return transforms.rotation_z(yaw) @ about_y @ about_x


def joints(text):
    return {joint.get('name'): joint for joint in ElementTree.fromstring(text).iter('joint')}


def test_camera_is_where_the_cell_says(tmp_path):
    cell = bench_cell()
    write_urdf(tmp_path / 'cell.urdf', CellDraft(turntable=cell.turntable))
    fixed = joints((tmp_path / 'cell.urdf').read_text())['camera_joint']
    origin = fixed.find('origin')
    angles = [float(value) for value in origin.get('rpy').split()]
    place = [float(value) for value in origin.get('xyz').split()]
    base_from_camera = transforms.rigid(matrix(*angles), place)
    expected = transforms.invert(cell.turntable.camera_from_base)
    np.testing.assert_allclose(base_from_camera, expected, atol=1e-8)
    assert fixed.find('child').get('link') == 'camera_optical_frame'


def test_table_turns_about_z():
    turning = joints(urdf(CellDraft(turntable=bench_cell().turntable)))['turntable_joint']
    assert turning.get('type') == 'continuous'
    assert turning.find('axis').get('xyz') == '0 0 1'
    assert turning.find('child').get('link') == 'turntable'


@pytest.mark.parametrize(
    'angles', [(0.3, -0.4, 2.9), (-3.0, 1.2, -1.0), (0.7, np.pi / 2, 0.0), (0.7, -np.pi / 2, 0.0)]
)
def test_rotation_comes_back(angles):
    R = matrix(*angles)
    np.testing.assert_allclose(matrix(*roll_pitch_yaw(R)), R, atol=1e-9)


def test_cell_without_turntable_is_refused():
    with pytest.raises(CellError, match='turntable: is missing'):
        urdf(CellDraft())
