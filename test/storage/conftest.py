# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small bags for the tests of storage."""

import cv2
from mcap.writer import Writer
import numpy as np
import pytest

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.messages import cdr

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@pytest.fixture
def camera():
    return Camera(
        width=64,
        height=48,
        K=np.array([[90.0, 0, 31.5], [0, 91.0, 23.5], [0, 0, 1]]),
        distortion=np.array([-0.1, 0.02, 0.001, -0.002, 0.0]),
    )


@pytest.fixture
def make_image():
    """Mono image of the camera's size, a different one for each number."""

    def make(number=0):
        return np.random.default_rng(number).integers(0, 255, (48, 64), dtype=np.uint8)

    return make


@pytest.fixture
def jpeg(make_image):
    return cv2.imencode('.jpg', make_image())[1].tobytes()


@pytest.fixture
def write_bag(tmp_path, camera, make_image):
    """
    Write a bag of raw images, 0.1 s and 0.1 rad from one to the next.

    before : is called with (bag, stamp, index) before each image
    """

    def write(name='bag', count=5, before=None, infos=True, joints=True, **options):
        with create_bag(tmp_path / name, **options) as bag:
            for index in range(count):
                stamp = START + index * SECOND // 10
                if joints:
                    bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
                if before is not None:
                    before(bag, stamp, index)
                if infos:
                    bag.camera_info(stamp, camera)
                bag.image(stamp, make_image(index))
        return tmp_path / name

    return write


@pytest.fixture
def write_mcap(tmp_path):
    """
    Write an MCAP file by the mcap library: (topic, type, messages or bytes), 1 s apart.

    A type of None writes no schema.
    """

    def write(*topics, name='foreign.mcap', encoding='cdr', **options):
        path = tmp_path / name
        with path.open('wb') as stream:
            writer = Writer(stream, **options)
            writer.start(profile='ros2')
            for topic, msgtype, messages in topics:
                text = cdr.definition(cdr.full_name(msgtype)).encode() if msgtype else b''
                schema = writer.register_schema(msgtype, 'ros2msg', text) if msgtype else 0
                channel = writer.register_channel(topic, encoding, schema)
                for index, message in enumerate(messages):
                    data = message if isinstance(message, bytes) else cdr.encode(message)
                    stamp = START + index * SECOND
                    writer.add_message(channel, stamp, data, stamp)
            writer.finish()
        return path

    return write
