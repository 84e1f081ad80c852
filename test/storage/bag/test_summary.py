# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A damaged index (summary section) never hides a topic: the messages are read instead."""

from dataclasses import replace
import random

import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.scans.scan_bag import open_scan

JOINT = sensor_messages.JOINT_STATE
COUNTS = {'/ivfmc/joint_states': 5, '/ivfmc/camera_info': 5, '/ivfmc/image_raw': 5}


def _joints(count):
    return [sensor_messages.joint_state(index, {'turntable_joint': 0.1}) for index in range(count)]


def _flip(path, where, bit=0x02):
    data = bytearray(path.read_bytes())
    data[where] ^= bit
    path.write_bytes(data)
    return path


def _counts(bag):
    return {name: topic.count for name, topic in bag.topics.items()}


@pytest.mark.parametrize('name', COUNTS)
def test_topic_renamed_by_a_flipped_bit_in_the_index_keeps_its_messages(write_bag, name):
    path = write_bag() / 'scan.mcap'
    _flip(path, path.read_bytes().rindex(name.encode()) + 8)
    bag = open_bag(path)
    assert _counts(bag) == COUNTS
    assert 'the index at the end of the file is damaged' in bag.remarks[0]
    assert len(list(bag.messages([name]))) == 5
    assert open_scan(path).frame_count == 5


def test_intact_index_needs_no_remark(write_bag):
    path = write_bag() / 'scan.mcap'
    assert open_bag(path).remarks == ()


@pytest.mark.parametrize('seed', range(12))
def test_flipped_bit_anywhere_in_the_index_loses_no_message(write_bag, seed):
    path = write_bag() / 'scan.mcap'
    content = path.read_bytes()
    begin = content.rindex(b'rosbag2', 0, content.rindex(b'sensor_msgs/msg/Image'))
    _flip(path, random.Random(seed).randrange(begin + 200, len(content)), 1 << seed % 8)
    try:
        bag = open_bag(path)
        read = len(list(bag.messages(COUNTS)))
    except BagError:
        return  # refused by name
    assert (_counts(bag), read) == (COUNTS, 15)


def test_index_without_a_crc_is_not_trusted(write_mcap):
    path = write_mcap(('/joint_states', JOINT, _joints(4)), enable_crcs=False)
    bag = open_bag(_flip(path, path.read_bytes().rindex(b'/joint_states') + 3))
    assert _counts(bag) == {'/joint_states': 4}
    assert bag.remarks == ()


def test_topic_renamed_in_the_data_without_a_crc_is_refused(write_mcap):
    path = write_mcap(('/joint_states', JOINT, _joints(4)), use_chunking=False)
    bag = open_bag(_flip(path, path.read_bytes().index(b'/joint_states') + 3))
    with pytest.raises(BagError, match=r'/joknt_states is in the messages, not in the index'):
        list(bag.messages(['/joint_states']))


def test_messages_that_the_index_does_not_count_are_refused(write_mcap):
    path = write_mcap(('/joint_states', JOINT, _joints(4)))
    bag = open_bag(path)
    topic = replace(bag.topics['/joint_states'], count=5)
    changed = replace(bag, topics={'/joint_states': topic})
    with pytest.raises(BagError, match=r'/joint_states has 4 messages, its index lists 5'):
        list(changed.messages(['/joint_states']))
