# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import struct

import numpy as np
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages

STAMP = 1_700_000_000_123_456_789


def _string(text, order='<'):
    data = text.encode() + b'\0'
    return struct.pack(f'{order}I', len(data)) + data


def _joint_state(order):
    """Build a JointState of one joint by hand, in either byte order."""
    body = struct.pack(f'{order}iI', 1_700_000_000, 123_456_789)
    body += _string('', order) + b'\0' * 3
    body += struct.pack(f'{order}I', 1) + _string('axis', order) + b'\0' * 3
    body += struct.pack(f'{order}I', 1) + b'\0' * (-(len(body) + 4) % 8)
    body += struct.pack(f'{order}d', 0.5)
    body += struct.pack(f'{order}I', 1) + b'\0' * 4 + struct.pack(f'{order}d', -2.0)
    body += struct.pack(f'{order}I', 0)
    return (b'\0\1\0\0' if order == '<' else b'\0\0\0\0') + body


def _decoder(msgtype):
    return cdr.decoder(msgtype, 'ros2msg', cdr.definition(msgtype))


def test_joint_state_has_golden_bytes():
    message = sensor_messages.joint_state(STAMP, {'axis': 0.5}, velocity=-2.0)
    assert cdr.encode(message) == _joint_state('<')


@pytest.mark.parametrize('order', ['<', '>'])
def test_both_byte_orders_are_read(order):
    message = _decoder(sensor_messages.JOINT_STATE)(_joint_state(order))
    assert cdr.stamp_ns(message) == STAMP
    assert message.name == ['axis']
    assert list(message.position) == [0.5]
    assert list(message.velocity) == [-2.0]
    assert list(message.effort) == []


def test_image_has_golden_bytes():
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    body = struct.pack('<iI', 1_700_000_000, 123_456_789) + _string('camera_optical_frame')
    body += b'\0' * (-len(body) % 4) + struct.pack('<II', 2, 3) + _string('mono8')
    body += b'\0' + b'\0' * (-(len(body) + 1) % 4) + struct.pack('<I', 3)
    body += struct.pack('<I', 6) + bytes(range(6))
    assert cdr.encode(sensor_messages.image(STAMP, image)) == b'\0\1\0\0' + body


def test_type_hash_is_that_of_jazzy():
    assert cdr.type_hash(sensor_messages.IMAGE) == (
        'RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47'
    )


@pytest.mark.parametrize(
    ('name', 'full'),
    [
        ('sensor_msgs/msg/Image', 'sensor_msgs/msg/Image'),
        ('sensor_msgs/Image', 'sensor_msgs/msg/Image'),
        ('std_srvs/srv/Trigger_Event', 'std_srvs/msg/Trigger_Event'),
    ],
)
def test_type_names_are_completed(name, full):
    assert cdr.full_name(name) == full


@pytest.mark.parametrize('keep', [0, 3, 4, 20, 60, -9])
def test_cut_message_is_refused(keep):
    with pytest.raises(BagError, match='bytes are not a sensor_msgs/msg/JointState'):
        _decoder(sensor_messages.JOINT_STATE)(_joint_state('<')[:keep])


def test_cut_picture_is_refused():
    data = cdr.encode(sensor_messages.image(STAMP, np.zeros((20, 30), np.uint8)))
    with pytest.raises(BagError, match='bytes are not a sensor_msgs/msg/Image'):
        _decoder(sensor_messages.IMAGE)(data[:-100])


def test_definition_in_the_bag_is_used():
    decode = cdr.decoder(
        'mine/msg/Point',
        'ros2msg',
        'float32 x\nmine/Unit unit\n'
        + '=' * 80
        + ('\nMSG: mine/Unit\nuint8 METRE=1\nuint8 unit\n'),
    )
    message = decode(b'\0\1\0\0' + struct.pack('<fB', 1.5, 1))
    assert (message.x, message.unit.unit) == (1.5, 1)


def test_omitted_definition_of_time_is_known():
    decode = cdr.decoder('mine/msg/When', 'ros2msg', 'builtin_interfaces/Time at\n')
    assert decode(b'\0\1\0\0' + struct.pack('<iI', 7, 8)).at.nanosec == 8


def test_idl_definition_is_used():
    text = f'{"=" * 80}\nIDL: mine/msg/Number\nmodule mine {{ module msg {{ struct Number {{ ' + (
        'double value; }; }; };\n'
    )
    decode = cdr.decoder('mine/msg/Number', 'ros2idl', text)
    assert decode(b'\0\1\0\0' + struct.pack('<d', 2.5)).value == 2.5


@pytest.mark.parametrize(
    ('encoding', 'text'),
    [('ros2msg', '???'), ('ros2msg', 'mine/Missing field\n'), ('protobuf', 'x'), ('ros2idl', '?')],
)
def test_definition_that_cannot_be_parsed_is_named(encoding, text):
    with pytest.raises(BagError, match='definition of mine/msg/Thing cannot be parsed'):
        cdr.decoder('mine/msg/Thing', encoding, text)(b'\0\1\0\0')


def test_definition_without_a_field_that_is_needed_is_named():
    name = 'sensor_msgs/msg/CameraInfo'
    other = cdr.definition(name).replace('uint32 height', 'uint32 rows')
    with pytest.raises(BagError, match="has no field 'height'; its fields are header, rows"):
        cdr.decoder(name, 'ros2msg', other)


def test_message_too_short_for_a_header_is_refused():
    with pytest.raises(BagError, match='3 bytes have no header'):
        cdr.leading_stamp_ns(b'\0\1\0')


def test_service_event_is_decoded_by_the_definition_of_the_service():
    # rosbag2 stores the definition of the service instead of the event
    text = 'bool data\n---\nbool success\nstring message\n'
    decode = cdr.decoder('std_srvs/srv/SetBool_Event', 'ros2msg', text)
    info = struct.pack('<B3xiI', 1, 7, 8) + bytes(range(16)) + b'\0' * 4 + struct.pack('<q', 3)
    request = struct.pack('<IB3x', 1, True)
    event = decode(b'\0\1\0\0' + info + request + struct.pack('<I', 0))
    assert event.info.sequence_number == 3
    assert event.request[0].data
    assert event.response == []
