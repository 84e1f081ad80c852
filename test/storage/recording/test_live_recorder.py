# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import os
import threading
import time

import pytest
from support.recordings import profile
from support.recordings import write_profiles

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.recording.taken_profiles import read_taken_profiles

START = 1_700_000_000_000_000_000
JOINTS = '/ivfmc/joint_states'
PROFILE = '/ivfmc/profile'


def state(index):
    return cdr.encode(sensor_messages.joint_state(START + index, {'turntable_joint': 0.1 * index}))


def add(recorder, index, topic=JOINTS, **options):
    return recorder.add(topic, sensor_messages.JOINT_STATE, state(index), START + index, **options)


def header_of(seq):
    return ProfileHeader(seq=seq, view=0, laser=0, angle=0.1 * seq, points=5, stamp_ns=START + seq)


def wait_until(condition):
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        threading.Event().wait(0.01)


@pytest.mark.parametrize('compress', [True, False])
def test_recorded_bag_can_be_read(tmp_path, compress):
    recorder = LiveRecorder(tmp_path, compress=compress)
    for index in range(20):
        assert add(recorder, index)
    assert recorder.stop() == tmp_path / 'scan.mcap'
    bag = open_bag(tmp_path)
    assert bag.topics[JOINTS].count == 20
    decode = bag.decoder(JOINTS)
    positions = [decode(raw).position[0] for raw in bag.messages([JOINTS])]
    assert positions == pytest.approx([0.1 * index for index in range(20)])
    assert not (tmp_path / PART_NAME).exists()


def test_bag_can_be_read_while_it_is_recorded(tmp_path):
    recorder = LiveRecorder(tmp_path)
    add(recorder, 0, PROFILE, header=header_of(0))
    wait_until(lambda: recorder.recorded == 0)
    bag = open_bag(tmp_path / PART_NAME, salvage=True)
    assert bag.topics[PROFILE].count == 1
    assert bag.damage is not None
    recorder.stop()


def test_view_that_has_ended_is_forced_to_the_disk(tmp_path, monkeypatch):
    sizes = []

    def sync(number):
        os.fsync(number)
        sizes.append(os.fstat(number).st_size)

    monkeypatch.setattr(os, 'fdatasync', sync)
    recorder = LiveRecorder(tmp_path)
    for seq, view in enumerate((0, 0, 1, 1, 2)):
        add(recorder, seq, PROFILE, header=replace(header_of(seq), view=view))
        wait_until(lambda seq=seq: recorder.recorded == seq)
        if view == 0:
            assert sizes == []
    recorder.stop()
    # when the first profile of view 1 and that of view 2 were in the file
    assert len(sizes) == 2
    assert 0 < sizes[0] < sizes[1] <= (tmp_path / 'scan.mcap').stat().st_size


def test_recorded_excludes_profiles_after_a_missing_one(tmp_path):
    flushed = []
    recorder = LiveRecorder(tmp_path, on_flush=flushed.extend)
    for seq in (0, 1, 3):
        add(recorder, seq, PROFILE, header=header_of(seq))
    wait_until(lambda: len(flushed) == 3)
    assert recorder.recorded == 1
    add(recorder, 2, PROFILE, header=header_of(2))
    wait_until(lambda: recorder.recorded == 3)
    recorder.stop()


def test_locations_are_those_of_the_profiles(tmp_path):
    flushed = []
    recorder = LiveRecorder(tmp_path, on_flush=flushed.extend)
    add(recorder, 7)
    add(recorder, 0, PROFILE, header=header_of(0))
    wait_until(lambda: flushed)
    add(recorder, 1, PROFILE, header=header_of(1))
    file = recorder.stop()
    first, second = flushed
    assert (first.index, second.index) == (0, 1)
    assert 0 < first.chunk_offset < second.chunk_offset
    data = file.read_bytes()
    chunk = 6  # opcode of MCAP
    assert data[first.chunk_offset] == chunk
    assert data[second.chunk_offset] == chunk


def test_messages_beyond_the_queue_are_dropped_and_counted_except_profiles(tmp_path):
    recorder = LiveRecorder(tmp_path, max_queued_bytes=0)
    assert not add(recorder, 0)
    assert add(recorder, 1, PROFILE, header=header_of(0))
    recorder.stop()
    assert recorder.counts.dropped_topics == {JOINTS: 1}
    assert recorder.recorded == 0


def test_existing_bag_is_not_overwritten(tmp_path):
    LiveRecorder(tmp_path).stop()
    with pytest.raises(FileError, match='exists already'):
        LiveRecorder(tmp_path)


def test_bag_that_was_cut_off_is_not_overwritten(tmp_path):
    (tmp_path / PART_NAME).write_bytes(b'')
    with pytest.raises(FileError, match='exists already'):
        LiveRecorder(tmp_path)


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match='nowhere'):
        LiveRecorder(tmp_path / 'nowhere')


def test_unknown_type_ends_the_recording_with_its_name(tmp_path):
    recorder = LiveRecorder(tmp_path)
    recorder.add('/x', 'my_msgs/msg/Own', b'', START)
    wait_until(lambda: recorder.error)
    add(recorder, 0)  # add never blocks
    with pytest.raises(FileError, match='my_msgs/msg/Own'):
        recorder.stop()


def test_interrupted_recording_goes_on_behind_its_last_profile(tmp_path):
    write_profiles(tmp_path / 'scan', range(7), per_chunk=2, finish=False)
    places = []
    with pytest.raises(BagError, match='has 6 profiles instead of 7'):
        LiveRecorder(tmp_path / 'scan', first_profile=7)
    recorder = LiveRecorder(tmp_path / 'scan', first_profile=6, on_flush=places.extend)
    assert recorder.recorded == 5
    assert [place.header.seq for place in places] == list(range(6))
    for seq in (7, 6):
        message = profile(seq)
        header = read_profile_header(message)
        recorder.add(PROFILE, POINT_CLOUD, cdr.encode(message), START + seq, header=header)
    wait_until(lambda: recorder.recorded == 7)
    recorder.stop()
    assert recorder.counts.messages == 8
    taken = read_taken_profiles(tmp_path / 'scan', with_points=True)
    assert sorted(taken.profiles) == list(range(8))
    assert taken.profiles[7].points_xyz[0, 0] == pytest.approx(700.0)
    assert [place.index for place in taken.locations] == list(range(8))


def test_bag_without_a_profile_of_its_middle_is_refused(tmp_path):
    write_profiles(tmp_path / 'gap', (0, 1, 3), per_chunk=1)
    with pytest.raises(BagError, match='profile 2 is not in it, profile 3 is'):
        read_taken_profiles(tmp_path / 'gap')
    write_profiles(tmp_path / 'twice', (0, 1, 1), per_chunk=1)
    with pytest.raises(BagError, match='profiles of the same number'):
        read_taken_profiles(tmp_path / 'twice')
    with pytest.raises(BagError, match='there is no such file'):
        read_taken_profiles(tmp_path)
