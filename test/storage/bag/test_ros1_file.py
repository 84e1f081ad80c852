# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags: read as the bag of the same messages in ROS 2, or refused by name."""

import struct

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
from support.foreign_bags import write_ros1
from support.recordings import messages_of
from support.table_transform import transforms

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.scans.scan_bag import open_scan

IMAGE = '/ivfmc/image_raw'


@pytest.fixture
def theirs(ours, tmp_path):
    return write_ros1(ours, tmp_path / 'theirs.bag')


def _images(path, **options):
    return [message for message in messages_of(path, **options) if message[0] == IMAGE]


@pytest.mark.parametrize('compression', [None, 'bz2', 'lz4'])
def test_ros1_bag_is_the_ros2_bag_of_its_messages(ours, tmp_path, compression):
    theirs = write_ros1(ours, tmp_path / 'theirs.bag', compression=compression)
    kinds, expected_kinds = (
        {name: (topic.msgtype, topic.count) for name, topic in open_bag(path).topics.items()}
        for path in (theirs, ours)
    )
    assert kinds == expected_kinds
    assert _images(theirs) == _images(ours)
    scan, expected_scan = open_scan(theirs), open_scan(ours)
    np.testing.assert_array_equal(scan.camera.K, expected_scan.camera.K)
    np.testing.assert_array_equal(scan.camera.distortion, expected_scan.camera.distortion)
    for frame, expected in zip(scan.frames(), expected_scan.frames(), strict=True):
        assert (frame.stamp_ns, frame.angle) == (expected.stamp_ns, expected.angle)
        np.testing.assert_array_equal(frame.image, expected.image)


def test_bytes_of_ros1_are_read(tmp_path):
    def text(value):
        return struct.pack('<I', len(value)) + value.encode()

    # a JointState as http://wiki.ros.org/msg says: little endian, not aligned
    header = struct.pack('<III', 7, 1_700_000_000, 5) + text('')
    names = struct.pack('<I', 2) + text('arm') + text('turntable_joint')
    numbers = struct.pack('<IddII', 2, 1.5, -0.25, 0, 0)
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(tmp_path / 'x.bag') as writer:
        connection = writer.add_connection('/j', sensor_messages.JOINT_STATE, typestore=store)
        writer.write(connection, 11, header + names + numbers)
    bag = open_bag(tmp_path / 'x.bag')
    [raw] = bag.messages(['/j'])
    message = bag.decoder('/j')(raw)
    assert (raw.log_time_ns, bag.stamp_ns(raw)) == (11, 1_700_000_000_000_000_005)
    assert (message.name, list(message.position)) == (['arm', 'turntable_joint'], [1.5, -0.25])
    assert not len(message.velocity)


def test_folder_of_one_ros1_bag_is_read(theirs):
    folder = theirs.parent / 'recorded'
    folder.mkdir()
    theirs.rename(folder / theirs.name)
    assert open_scan(folder).frame_count == 12


@pytest.mark.parametrize('name', ['tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'])
def test_table_is_read_from_transforms_of_ros1(write_mcap, camera, make_image, tmp_path, name):
    stamps = [1_700_000_000_000_000_000 + k * 1_000_000_000 for k in range(5)]
    source = write_mcap(
        (
            '/tf',
            sensor_messages.TF_MESSAGE,
            [transforms(s, 0.1 * k) for k, s in enumerate(stamps)],
        ),
        (
            '/image_raw',
            sensor_messages.IMAGE,
            [sensor_messages.image(s, make_image(k)) for k, s in enumerate(stamps)],
        ),
        (
            '/camera_info',
            sensor_messages.CAMERA_INFO,
            [sensor_messages.camera_info(s, camera) for s in stamps],
        ),
    )
    theirs = write_ros1(source, tmp_path / 'theirs.bag', transforms=name)
    angles = [frame.angle for frame in open_scan(theirs).frames()]
    assert angles == pytest.approx([frame.angle for frame in open_scan(source).frames()])
    assert angles == pytest.approx([0.1 * k for k in range(5)])


def test_file_that_is_cut_off_is_refused_by_name(theirs):
    content = theirs.read_bytes()
    for keep in range(9, len(content), 1021):
        theirs.write_bytes(content[:keep])
        with pytest.raises(
            BagError, match=r'theirs\.bag: cannot be read as a ROS 1 bag .*reindex'
        ):
            open_bag(theirs)


def test_damage_in_a_chunk_is_named_and_what_precedes_it_is_salvaged(write_bag, tmp_path):
    ours = write_bag(count=800)
    theirs = write_ros1(ours, tmp_path / 'theirs.bag', compression='bz2')
    whole, content = _images(theirs), bytearray(theirs.read_bytes())
    # chunks of 1 MiB: in the second one
    second = content.index(b'BZh', content.index(b'BZh') + 3)
    content[second + 5000 : second + 5100] = bytes(100)
    theirs.write_bytes(content)
    with pytest.raises(BagError, match=r'theirs\.bag: the file is damaged .*messages can be read'):
        _images(theirs)
    left = _images(theirs, salvage=True)
    assert 0 < len(left) < 800
    assert left == whole[: len(left)]
