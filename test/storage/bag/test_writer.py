# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import errno
import os

from mcap.records import Chunk
from mcap.stream_reader import StreamReader
import numpy as np
import pytest
import yaml

from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages

HEADER = 'std_msgs/msg/Header'


def _full(folder, camera, make_image, jpeg):
    with create_bag(folder) as bag:
        bag.joint_state(1_000_000_000, 'turntable_joint', 0.25, velocity=0.5)
        bag.laser_state(1_100_000_000, {'left': True, 'right': False})
        bag.camera_info(2_000_000_000, camera)
        bag.image(2_000_000_000, make_image())
        bag.compressed_image(3_000_000_001, jpeg, 'jpeg')
    return folder


def _left_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_another_reader_decodes_every_message(tmp_path, camera, make_image, jpeg):
    reader = pytest.importorskip('mcap_ros2.reader')
    folder = _full(tmp_path / 'bag', camera, make_image, jpeg)
    read = {
        message.channel.topic: message.ros_msg
        for message in reader.read_ros2_messages(str(folder / 'scan.mcap'))
    }
    joint, laser = read['/ivfmc/joint_states'], read['/ivfmc/laser_states']
    assert (joint.name, joint.position, joint.velocity) == (['turntable_joint'], [0.25], [0.5])
    assert (laser.name, laser.position, laser.velocity) == (['left', 'right'], [1.0, 0.0], [])
    info = read['/ivfmc/camera_info']
    assert (info.width, info.height, info.distortion_model) == (64, 48, 'plumb_bob')
    assert (info.d, info.k) == (camera.distortion.tolist(), camera.K.ravel().tolist())
    assert info.r == np.eye(3).ravel().tolist()
    assert np.reshape(info.p, (3, 4))[:, 3].tolist() == [0, 0, 0]
    image = read['/ivfmc/image_raw']
    assert (image.encoding, image.step, image.data) == ('mono8', 64, make_image().tobytes())
    assert image.header.frame_id == 'camera_optical_frame'
    compressed = read['/ivfmc/image_raw/compressed']
    assert (compressed.format, compressed.data) == ('jpeg', jpeg)
    assert (compressed.header.stamp.sec, compressed.header.stamp.nanosec) == (3, 1)


def test_rosbag2_metadata_is_understood_by_another_reader(tmp_path, camera, make_image, jpeg):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    with rosbag2.Reader(_full(tmp_path / 'bag', camera, make_image, jpeg)) as reader:
        assert reader.message_count == 5
        assert reader.start_time == 1_000_000_000
        assert {item.topic: item.msgtype for item in reader.connections} == {
            '/ivfmc/joint_states': 'sensor_msgs/msg/JointState',
            '/ivfmc/laser_states': 'sensor_msgs/msg/JointState',
            '/ivfmc/camera_info': 'sensor_msgs/msg/CameraInfo',
            '/ivfmc/image_raw': 'sensor_msgs/msg/Image',
            '/ivfmc/image_raw/compressed': 'sensor_msgs/msg/CompressedImage',
        }
        durability = {
            item.topic: item.ext.offered_qos_profiles[0].durability.name
            for item in reader.connections
        }
    assert durability.pop('/ivfmc/laser_states') == 'TRANSIENT_LOCAL'
    assert set(durability.values()) == {'VOLATILE'}


def test_metadata_is_that_of_jazzy(tmp_path, camera, make_image, jpeg):
    folder = _full(tmp_path / 'bag', camera, make_image, jpeg)
    text = (folder / 'metadata.yaml').read_text()
    assert '&' not in text
    info = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert (info['version'], info['storage_identifier']) == (9, 'mcap')
    assert info['relative_file_paths'] == ['scan.mcap']
    assert info['duration'] == {'nanoseconds': 2_000_000_001}
    topic = info['topics_with_message_count'][0]
    assert topic['message_count'] == 1
    assert topic['topic_metadata']['offered_qos_profiles'][0]['history'] == 'keep_last'
    assert topic['topic_metadata']['type_description_hash'].startswith('RIHS01_')


@pytest.mark.parametrize(('compress', 'name'), [(True, 'zstd'), (False, '')])
def test_chunks_carry_checksums(write_bag, compress, name):
    folder = write_bag(compress=compress)
    with (folder / 'scan.mcap').open('rb') as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert records[0].profile == 'ros2'
    assert chunks
    assert all(chunk.uncompressed_crc for chunk in chunks)
    assert {chunk.compression for chunk in chunks} == {name}


def test_same_content_gives_same_bytes(write_bag):
    first, second = write_bag('a'), write_bag('b')
    assert (first / 'scan.mcap').read_bytes() == (second / 'scan.mcap').read_bytes()


@pytest.mark.parametrize('error', [RuntimeError, KeyboardInterrupt])
def test_nothing_is_left_of_a_bag_that_failed(tmp_path, make_image, error):
    with pytest.raises(error), create_bag(tmp_path / 'bag') as bag:
        bag.image(1, make_image())
        assert not (tmp_path / 'bag').exists()
        raise error
    assert _left_in(tmp_path) == []


def test_nothing_is_left_when_the_disk_is_full(tmp_path, make_image, monkeypatch):
    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'fsync', full)
    refused = pytest.raises(FileError, match='bag: cannot be written: No space left')
    with refused, create_bag(tmp_path / 'bag') as bag:
        bag.image(1, make_image())
    assert _left_in(tmp_path) == []


@pytest.mark.parametrize('kind', ['folder', 'file'])
def test_existing_target_is_refused(tmp_path, kind):
    target = tmp_path / 'bag'
    if kind == 'folder':
        target.mkdir()
        (target / 'scan.mcap').write_text('mine')
    else:
        target.write_text('mine')
    with pytest.raises(FileError, match='bag: exists already and is not overwritten'):
        create_bag(target).__enter__()
    assert _left_in(tmp_path) == ['bag']


def test_target_that_appears_meanwhile_is_kept(tmp_path, make_image):
    refused = pytest.raises(FileError, match='bag: cannot be written: Directory not empty')
    with refused, create_bag(tmp_path / 'bag') as bag:
        bag.image(1, make_image())
        (tmp_path / 'bag').mkdir()
        (tmp_path / 'bag' / 'scan.mcap').write_text('mine')
    assert _left_in(tmp_path) == ['bag']
    assert (tmp_path / 'bag' / 'scan.mcap').read_text() == 'mine'


def test_parent_that_is_no_folder_is_named(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(FileError, match='file/bag: cannot be written: '):
        create_bag(tmp_path / 'file' / 'bag').__enter__()


def test_bag_is_as_readable_as_any_new_folder(tmp_path, write_bag):
    (tmp_path / 'other').mkdir()
    assert write_bag().stat().st_mode == (tmp_path / 'other').stat().st_mode


def test_raw_bytes_are_written_as_they_are(tmp_path):
    data = cdr.encode(sensor_messages.joint_state(5, {'a': 1.0}))
    with create_bag(tmp_path / 'bag', namespace='/cell') as bag:
        bag.write('joint_states', sensor_messages.JOINT_STATE, data, 5)
        bag.write('/tf', sensor_messages.JOINT_STATE, data, 6)
        bag.write('own', 'mine/msg/Own', b'\0\1\0\0\7', 7, definition='uint8 value\n')
    bag = open_bag(tmp_path / 'bag')
    assert set(bag.topics) == {'/cell/joint_states', '/tf', '/cell/own'}
    raw = next(bag.messages(['/tf']))
    assert (raw.data, raw.log_time_ns) == (data, 6)
    assert bag.decoder('/cell/own')(next(bag.messages(['/cell/own']))).value == 7


def test_type_that_is_not_known_needs_its_definition(tmp_path):
    refused = pytest.raises(FileError, match='/ivfmc/own: no definition of mine/msg/Own is known')
    with refused, create_bag(tmp_path / 'bag') as bag:
        bag.write('own', 'mine/msg/Own', b'', 7)
    assert _left_in(tmp_path) == []


def test_topic_keeps_its_type(tmp_path, make_image):
    refused = pytest.raises(FileError, match='image_raw: holds sensor_msgs/msg/Image, not std')
    with refused, create_bag(tmp_path / 'bag') as bag:
        bag.image(1, make_image())
        bag.write('image_raw', 'std_msgs/msg/Header', b'', 2)


def test_empty_bag_can_be_read(tmp_path):
    with create_bag(tmp_path / 'bag'):
        pass
    assert open_bag(tmp_path / 'bag').message_count == 0


def test_bag_that_grows_can_be_read_up_to_its_last_chunk(tmp_path, make_image):
    bag = BagWriter(tmp_path)
    assert bag.flush() is None
    data = cdr.encode(cdr.header(0, ''))
    assert [bag.write('/a', HEADER, data, stamp) for stamp in (1, 2)] == [0, 1]
    assert bag.flush() > 0
    bag.write('/a', HEADER, data, 3)
    assert open_bag(tmp_path / PART_NAME, salvage=True).topics['/a'].count == 2
    bag.close()
    assert _left_in(tmp_path) == [PART_NAME]


def test_bag_that_grows_gets_its_name_at_the_end(tmp_path):
    bag = BagWriter(tmp_path)
    assert bag.finish() == tmp_path / 'scan.mcap'
    assert _left_in(tmp_path) == ['metadata.yaml', 'scan.mcap']
    with pytest.raises(FileError, match=r'scan\.mcap: exists already'):
        BagWriter(tmp_path)
