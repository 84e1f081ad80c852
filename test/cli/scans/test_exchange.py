# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cloud of a scan as PLY."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.recordings import profile_message
from support.recordings import START

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.point_clouds import PROFILE_POINT_DTYPE
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD

SCAN = '20261127T100000Z_part'
POSES = 'geometry_msgs/msg/PoseArray'
ROWS, COLUMNS = 3, 4
TURN = Rotation.from_rotvec([0.0, 0.0, 0.3])


def view_records(number):
    records = np.zeros((ROWS, COLUMNS), dtype=PROFILE_POINT_DTYPE)
    records['x'] = 0.001 * np.arange(ROWS)[:, None] + 0.01 * np.arange(COLUMNS)
    records['y'], records['z'] = 0.002, 0.01 * number
    records['sigma'] = 1e-5 * (1 + number)
    records['view'] = number
    records['x'][0, 0] = np.nan
    return records


def pose(rotation):
    x, y, z, w = rotation.as_quat()
    return cdr.message(
        'geometry_msgs/msg/Pose',
        position=cdr.message('geometry_msgs/msg/Point', x=0.0, y=0.0, z=0.001),
        orientation=cdr.message('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
    )


@pytest.fixture
def root(tmp_path):
    """Folder of the scans with one of two views, the second of which is turned."""
    folder = tmp_path / 'scans' / SCAN
    folder.mkdir(parents=True)
    bag = BagWriter(folder)
    for number in range(2):
        records = view_records(number)
        step = COLUMNS * PROFILE_POINT_DTYPE.itemsize
        flat = profile_message(records.ravel(), START)
        message = replace(flat, height=ROWS, width=COLUMNS, row_step=step)
        bag.write('view', POINT_CLOUD, cdr.encode(message), START + number)
    poses = [pose(Rotation.identity()), pose(TURN)]
    message = cdr.message(POSES, header=cdr.header(START, 'turntable'), poses=poses)
    bag.write('view_poses', POSES, cdr.encode(message), START + 5)
    bag.finish()
    bag.close()
    rebuild_scan(Catalogue(tmp_path / 'scans', create=True), folder)
    return tmp_path / 'scans'


def read_ply(path):
    head, _, body = path.read_bytes().partition(b'end_header\n')
    assert b'property float sigma' in head
    return np.frombuffer(body, '<f4').reshape(-1, 4), head.decode()


@pytest.mark.parametrize(('unit', 'scale'), [('mm', 1e3), ('m', 1.0)])
def test_cloud_has_the_registered_points_with_their_sigma(command, root, tmp_path, unit, scale):
    target = tmp_path / 'part.ply'
    answer = command('export', SCAN, '--scans', root, '-o', target, '--unit', unit)
    assert answer.exit_code == 0, answer.exception
    found, head = read_ply(target)
    assert f'unit {unit}' in head
    # the NaN of each view is left out
    assert found.shape == (2 * (ROWS * COLUMNS - 1), 4)
    records = view_records(1)
    points = np.stack([records[name] for name in 'xyz'], axis=-1)[np.isfinite(records['x'])]
    expected = (TURN.apply(points) + np.array([0.0, 0.0, 0.001])) * scale
    np.testing.assert_allclose(found[ROWS * COLUMNS - 1 :, :3], expected, atol=1e-6 * scale)
    np.testing.assert_allclose(found[-1, 3], 2e-5 * scale, rtol=1e-5)


def test_cloud_is_not_written_over_a_file(command, root, tmp_path):
    target = tmp_path / 'part.ply'
    target.write_text('x')
    answer = command('export', SCAN, '--scans', root, '-o', target)
    assert isinstance(answer.exception, FileError)
    assert target.read_text() == 'x'


@pytest.mark.parametrize(
    ('name', 'more', 'said'),
    [
        ('part.e57', [], r'part\.e57: must end with \.zip or \.ply'),
        ('part.ply', ['--without-pictures'], 'has no pictures'),
    ],
)
def test_target_that_cannot_be_written_is_named(command, root, tmp_path, name, more, said):
    answer = command('export', SCAN, '--scans', root, '-o', tmp_path / name, *more)
    with pytest.raises(ParameterError, match=said):
        raise answer.exception


def test_scan_without_registered_views_is_named(command, recorded, tmp_path):
    target = tmp_path / 'part.ply'
    scan = '20261125T100000Z_bracket'
    answer = command('export', scan, '--scans', recorded, '-o', target)
    assert isinstance(answer.exception, BagError)
    assert 'has no messages on view' in str(answer.exception)
    assert not target.exists()
