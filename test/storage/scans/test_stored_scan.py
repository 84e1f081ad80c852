# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.recordings import profile_message
from support.synthetic import small_cell

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import CellError
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.messages.point_clouds import PROFILE_POINT_DTYPE
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.scans.stored_scan import load_profiles
from ivfmc_ros.storage.scans.stored_scan import read_profiles

TOPIC = '/ivfmc/profile'
CLOUD = 'sensor_msgs/msg/PointCloud2'
START = 1_700_000_000_000_000_000


def cloud(seq, points=4):
    records = np.zeros(points, dtype=PROFILE_POINT_DTYPE)
    records['x'] = np.arange(points) + 100.0 * seq
    records['seq'], records['view'], records['laser'] = seq, 1, 1
    records['angle'] = 0.1 * seq
    return profile_message(records, START + seq)


def header_of(seq):
    return ProfileHeader(seq=seq, view=1, laser=1, angle=0.1 * seq, points=4, stamp_ns=START + seq)


@pytest.fixture
def catalogue(tmp_path):
    """Catalogue of scan s1 with three profiles between joint states."""
    made = Catalogue(tmp_path, create=True)
    made.add_scan('s1', 'part', '', 'DONE', {})
    (tmp_path / 's1').mkdir()
    recorder = LiveRecorder(
        tmp_path / 's1', on_flush=lambda locations: made.add_profiles('s1', locations)
    )
    for seq in range(3):
        state = cdr.encode(sensor_messages.joint_state(START + seq, {'turntable_joint': 0.0}))
        # same log time and same index in its topic as the profile
        recorder.add('/ivfmc/joint_states', sensor_messages.JOINT_STATE, state, START + seq)
        recorder.add(TOPIC, CLOUD, cdr.encode(cloud(seq)), START + seq, header=header_of(seq))
    recorder.stop()
    return made


def test_points_are_those_that_were_recorded(catalogue):
    profiles = list(read_profiles(catalogue, 's1'))
    assert [profile.seq for profile in profiles] == [0, 1, 2]
    assert [profile.points_xyz[1, 0] for profile in profiles] == [1.0, 101.0, 201.0]
    assert profiles[2].angle == pytest.approx(0.2)
    assert (profiles[2].view, profiles[2].stamp_ns) == (1, START + 2)


def test_incomplete_bag_has_the_profiles_of_the_catalogue(catalogue, tmp_path):
    (tmp_path / 's1' / 'scan.mcap').rename(tmp_path / 's1' / PART_NAME)
    assert len(list(read_profiles(catalogue, 's1'))) == 3


def test_scan_without_profiles_is_refused(catalogue):
    catalogue.add_scan('s2', 'part', '', 'FAILED', {})
    with pytest.raises(CatalogueError, match='has no profiles'):
        list(read_profiles(catalogue, 's2'))


def test_unknown_scan_is_refused(catalogue):
    with pytest.raises(CatalogueError, match='has no scan'):
        list(read_profiles(catalogue, 's3'))


def test_missing_bag_is_named(catalogue, tmp_path):
    (tmp_path / 's1' / 'scan.mcap').unlink()
    with pytest.raises(BagError, match=r'scan\.mcap: there is no such file'):
        list(read_profiles(catalogue, 's1'))


def test_changed_bag_is_refused(catalogue, tmp_path):
    offset = catalogue.profiles('s1')[0].chunk_offset
    file = tmp_path / 's1' / 'scan.mcap'
    data = bytearray(file.read_bytes())
    data[offset + 60] ^= 0xFF
    file.write_bytes(data)
    with pytest.raises(BagError, match='damaged'):
        list(read_profiles(catalogue, 's1'))


def test_cell_of_fewer_lasers_is_refused(catalogue, tmp_path):
    cell = small_cell()
    save_camera(tmp_path / 'camera.yaml', cell.camera)
    for count in (2, 1):
        save_cell(tmp_path / 'cell.yaml', replace(cell, lasers=cell.lasers[:count]))
        files = tmp_path / 'cell.yaml', tmp_path / 'camera.yaml'
        if count == 2:
            assert len(load_profiles(tmp_path, 's1', *files)[0]) == 3
            continue
        with pytest.raises(CellError, match=r'cell\.yaml: lasers: has 1 \(left\), .* least 2'):
            load_profiles(tmp_path, 's1', *files)
