# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag that an interrupted recorder left is written on, and is one bag for every reader."""

import fcntl

from mcap.reader import make_reader
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
from support.recordings import profile
from support.recordings import START
from support.recordings import write_profiles

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.mcap_writer import McapWriter
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.bag.unfinished_mcap import read_written_part
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.repair.check import check_recording

TOPIC = '/ivfmc/profile'
HEADER = 'std_msgs/msg/Header'
# Profiles of the interrupted recording, and in each of its chunks.
COUNT, PER_CHUNK = 12, 3


def seqs_by_mcap(file):
    """Numbers of the profiles by the index of the mcap library, all messages with their CRC."""
    with file.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [message.log_time for _, _, message in reader.iter_messages(topics=[TOPIC])]


def seqs_by_rosbags(folder):
    """Numbers of the profiles by the decoded messages of the rosbags library."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as reader:
        chosen = [one for one in reader.connections if one.topic == TOPIC]
        found = []
        for connection, _, data in reader.messages(chosen):
            message = store.deserialize_cdr(data, connection.msgtype)
            found.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        return found


def go_on(folder, first, last, **options):
    bag = BagWriter(folder, append=True, chunk_bytes=None, **options)
    for seq in range(first, last):
        bag.write('profile', POINT_CLOUD, cdr.encode(profile(seq)), START + seq * 10**8)
        bag.flush()
    bag.write('note', HEADER, cdr.encode(cdr.header(START, 'resumed')), START + 1)
    bag.finish()
    return bag


def cuts(file):
    """Offsets of each class: at, in and behind every record behind the first chunk."""
    data = file.read_bytes()
    chunks = [part.offset for part in read_parts(file) if isinstance(part, IntactPart)]
    chunks = [offset for offset in chunks if data[offset] == 6]
    found = {len(data)}
    for begin, end in zip(chunks, [*chunks[1:], len(data)], strict=True):
        if begin == chunks[0]:
            continue
        length = int.from_bytes(data[begin + 1 : begin + 9], 'little') + 9
        found |= {begin, begin + 1, begin + 5, begin + 40, begin + length - 1, begin + length}
        found |= {begin + length + 3, (begin + length + end) // 2, end - 1, end}
    return sorted(found)


@pytest.fixture(scope='module')
def interrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recording') / 'scan'
    write_profiles(folder, range(COUNT), per_chunk=PER_CHUNK, finish=False)
    return (folder / PART_NAME).read_bytes(), cuts(folder / PART_NAME)


def test_bag_cut_anywhere_is_written_on_and_read_by_both_libraries(interrupted, tmp_path):
    data, offsets = interrupted
    assert len(offsets) > 20
    for number, offset in enumerate(offsets):
        folder = tmp_path / f'cut {number}'
        folder.mkdir()
        (folder / PART_NAME).write_bytes(data[:offset])
        written = read_written_part(folder / PART_NAME)
        kept = written.counts.total()
        assert kept % PER_CHUNK == 0
        assert kept >= PER_CHUNK
        places = [index.chunk_start_offset for index in written.chunk_indices]
        bag = go_on(folder, kept, kept + 5)
        assert bag.kept_messages == kept
        stamps = [START + seq * 10**8 for seq in range(kept + 5)]
        assert seqs_by_mcap(folder / FILE_NAME) == stamps
        assert seqs_by_rosbags(folder) == stamps
        check = check_recording(folder)
        assert check.is_sound, check.lines()
        assert check.is_complete, check.lines()
        assert sorted(check.files[0].profiles) == list(range(kept + 5))
        # places of the catalogue stay valid
        again = read_written_part(folder / FILE_NAME).chunk_indices
        assert [index.chunk_start_offset for index in again][: len(places)] == places


def test_finished_bag_is_written_on(tmp_path):
    folder = tmp_path / 'scan'
    write_profiles(folder, range(COUNT), per_chunk=PER_CHUNK)
    go_on(folder, COUNT, COUNT + 2)
    go_on(folder, COUNT + 2, COUNT + 4)
    stamps = [START + seq * 10**8 for seq in range(COUNT + 4)]
    assert seqs_by_mcap(folder / FILE_NAME) == seqs_by_rosbags(folder) == stamps
    check = check_recording(folder)
    assert check.is_sound, check.lines()
    assert check.messages == {TOPIC: COUNT + 4, '/ivfmc/note': 2}


def test_finished_bag_that_is_opened_is_unfinished_again(tmp_path):
    folder = tmp_path / 'scan'
    write_profiles(folder, range(COUNT), per_chunk=PER_CHUNK)
    bag = BagWriter(folder, append=True)
    bag.close()
    assert [path.name for path in folder.iterdir()] == [PART_NAME]
    assert read_written_part(folder / PART_NAME).counts.total() == COUNT


def test_damage_in_the_middle_is_refused_and_nothing_is_changed(tmp_path):
    folder = tmp_path / 'scan'
    write_profiles(folder, range(COUNT), per_chunk=PER_CHUNK)
    file = folder / FILE_NAME
    data = bytearray(file.read_bytes())
    second = read_written_part(file).chunk_indices[1]
    data[second.chunk_start_offset + second.chunk_length // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(BagError, match='before its last chunk; ivfmc scans repair'):
        BagWriter(folder, append=True)
    assert file.read_bytes() == data
    assert (folder / 'metadata.yaml').exists()


def test_bag_that_is_gone_repaired_recorded_or_of_another_program_is_refused(tmp_path):
    folder = tmp_path / 'scan'
    folder.mkdir()
    with pytest.raises(FileError, match='there is no bag to go on with'):
        BagWriter(folder, append=True)
    with (folder / FILE_NAME).open('wb') as stream:
        McapWriter(stream, library='another').finish()
    with pytest.raises(BagError, match="was written by 'another'"):
        BagWriter(folder, append=True)
    (folder / FILE_NAME).rename(folder / PART_NAME)
    with (folder / PART_NAME).open('rb') as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(FileError, match='is being recorded'):
            BagWriter(folder, append=True)
    (folder / FILE_NAME).write_bytes(b'')
    with pytest.raises(FileError, match='the recording was repaired'):
        BagWriter(folder, append=True)
    (folder / FILE_NAME).unlink()
    (folder / PART_NAME).write_bytes(b'not a bag')
    with pytest.raises(BagError, match='is not an MCAP file'):
        BagWriter(folder, append=True)


def test_bag_without_a_chunk_is_begun_anew(tmp_path):
    folder = tmp_path / 'scan'
    write_profiles(folder, (), per_chunk=1, finish=False)
    go_on(folder, 0, 2)
    assert seqs_by_rosbags(folder) == [START, START + 10**8]
