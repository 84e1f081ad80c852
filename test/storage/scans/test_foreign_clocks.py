# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose stamps cannot be used, and bags with transforms instead of joint states."""

from mcap.writer import Writer
import numpy as np
import pytest
from support.table_transform import transform

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.scans.scan_bag import open_scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 10
COUNT = 8


@pytest.fixture
def write(tmp_path, camera, make_image):
    """
    Write a bag with tf; ``stamp`` returns the stamp of a message that is recorded at a time.

    The table turns by 0.9 rad between two images: more than a turn in all.
    """

    def write(stamp=lambda time_ns: time_ns, frame='turntable', tilt=0.0):
        path = tmp_path / 'tf.mcap'
        with path.open('wb') as stream:
            writer = Writer(stream)
            writer.start(profile='ros2')
            channels = {}
            for topic, msgtype in (
                ('/tf', sensor_messages.TF_MESSAGE),
                ('/image_raw', sensor_messages.IMAGE),
                ('/camera_info', sensor_messages.CAMERA_INFO),
            ):
                text = cdr.definition(msgtype).encode()
                schema = writer.register_schema(msgtype, 'ros2msg', text)
                channels[topic] = writer.register_channel(topic, 'cdr', schema)

            def add(topic, time_ns, message):
                writer.add_message(channels[topic], time_ns, cdr.encode(message), time_ns)

            for index in range(COUNT):
                now = START + index * STEP
                at = stamp(now)
                others = [transform(at, 'arm', 1.0), transform(at, frame, 0.9 * index, tilt)]
                tf = cdr.message(sensor_messages.TF_MESSAGE, transforms=others)
                add('/tf', now, tf)
                add('/camera_info', now, sensor_messages.camera_info(at, camera))
                add('/image_raw', now, sensor_messages.image(at, make_image(index)))
            writer.finish()
        return path

    return write


def angles(scan):
    return [frame.angle for frame in scan.frames()]


def test_table_is_read_from_its_transforms(write):
    scan = open_scan(write())
    np.testing.assert_allclose(angles(scan), 0.9 * np.arange(COUNT), atol=1e-6)


def test_frame_of_another_name_is_chosen(write):
    path = write(frame='/plate')
    with pytest.raises(BagError, match='child frames there: arm, plate'):
        open_scan(path)
    scan = open_scan(path, table_frame='plate')
    np.testing.assert_allclose(angles(scan), 0.9 * np.arange(COUNT), atol=1e-6)


def test_frame_that_tilts_is_refused(write):
    with pytest.raises(BagError, match="frame 'turntable' does not turn about z"):
        open_scan(write(tilt=0.05))


def test_times_of_recording_replace_stamps_of_zero_and_it_is_said(write, make_image):
    path = write(stamp=lambda time_ns: 0)
    with pytest.raises(BagError, match='does not set header'):
        open_scan(path)
    scan = open_scan(path, received=True)
    np.testing.assert_allclose(angles(scan), 0.9 * np.arange(COUNT), atol=1e-6)
    for index, frame in enumerate(scan.frames()):
        assert frame.stamp_ns == START + index * STEP
        np.testing.assert_array_equal(frame.image, make_image(index))
    assert any('times at which messages were recorded' in remark for remark in scan.remarks)


def test_times_of_recording_replace_stamps_of_clocks_that_differ(write_bag):
    path = write_bag(count=5)
    by_stamp, by_time = open_scan(path), open_scan(path, received=True)
    # our own writer records at the stamps
    assert angles(by_stamp) == angles(by_time)
    assert not any('recorded are used' in remark for remark in by_stamp.remarks)
