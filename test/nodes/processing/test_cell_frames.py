# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from types import ModuleType
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.synthetic import small_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.urdf import urdf
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.processing import cell_frames
from ivfmc_ros.nodes.processing.cell_frames import camera_transform
from ivfmc_ros.nodes.processing.cell_frames import CellFrames
from ivfmc_ros.nodes.processing.cell_frames import table_transform

CELL = small_cell()
DRAFT = CellDraft(turntable=CELL.turntable, lasers=CELL.lasers)


class FakeNode:
    """What CellFrames needs of a node; messages are kept by topic."""

    def __init__(self, publish_tf=True):
        self.publish_tf, self.now_s, self.sent, self.callbacks = publish_tf, 0.0, {}, []

    def parameter(self, name, default, text, **limits):
        assert (name, default) == ('publish_tf', True)
        return self.publish_tf

    def publish_on(self, kind, topic):
        self.sent[topic] = []
        return SimpleNamespace(publish=self.sent[topic].append)

    def changed(self, callback):
        self.callbacks.append(callback)

    def steady_s(self):
        return self.now_s

    def now_ns(self):
        return 5_000_000_000


@pytest.fixture
def tf2(monkeypatch):
    """A stand-in for tf2_msgs, which is on no computer without ROS."""
    module = ModuleType('tf2_msgs.msg')
    module.TFMessage = SimpleNamespace
    monkeypatch.setitem(cell_frames.importlib.sys.modules, 'tf2_msgs', ModuleType('tf2_msgs'))
    monkeypatch.setitem(cell_frames.importlib.sys.modules, 'tf2_msgs.msg', module)


@pytest.fixture
def no_tf2(monkeypatch):
    # None in sys.modules: the import fails, also where the package is installed
    monkeypatch.setitem(cell_frames.importlib.sys.modules, 'tf2_msgs.msg', None)


def matrix(message):
    place, turn = message.transform.translation, message.transform.rotation
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    T[:3, 3] = place.x, place.y, place.z
    return T


def test_transforms_are_those_of_the_cell():
    fixed, table = camera_transform(DRAFT, 7), table_transform(0.5, 1_500_000_000)
    assert (fixed.header.frame_id, fixed.child_frame_id) == (
        'turntable_base',
        'camera_optical_frame',
    )
    assert (table.header.frame_id, table.child_frame_id) == ('turntable_base', 'turntable')
    assert (table.header.stamp.sec, table.header.stamp.nanosec) == (1, 500_000_000)
    # a point that turns with the part, as tf2 looks it up in the camera
    looked_up = np.linalg.inv(matrix(fixed)) @ matrix(table) @ (0.03, 0.01, 0.02, 1.0)
    c, s = np.cos(0.5), np.sin(0.5)
    in_base = np.array([[0.03 * c - 0.01 * s, 0.03 * s + 0.01 * c, 0.02]])
    expected = transforms.apply(CELL.turntable.camera_from_base, in_base)[0]
    assert looked_up[:3] == pytest.approx(expected, abs=1e-9)


def test_cell_without_a_table_has_no_transform():
    assert camera_transform(CellDraft(), 0) is None


def test_frames_are_published_once_and_again_when_the_cell_changes(tf2):
    node, source = FakeNode(), SimpleNamespace(draft=None)
    frames = CellFrames(node, source)
    assert frames.state == 'published'
    assert node.sent['robot_description'] == node.sent['/tf_static'] == []
    source.draft = DRAFT
    for _ in range(3):
        node.callbacks[0]({'cell'})
    assert [message.data for message in node.sent['robot_description']] == [urdf(DRAFT)]
    ((fixed,),) = [message.transforms for message in node.sent['/tf_static']]
    assert matrix(fixed) == pytest.approx(transforms.invert(CELL.turntable.camera_from_base))


def test_table_is_published_at_most_30_times_a_second(tf2):
    node = FakeNode()
    frames = CellFrames(node, SimpleNamespace(draft=DRAFT))
    for number in range(200):
        node.now_s = number / 100
        frames.turn(number, 0.01 * number)
    sent = [message.transforms[0] for message in node.sent['/tf']]
    assert 45 <= len(sent) <= 60
    angle = 0.01 * sent[-1].header.stamp.nanosec
    assert matrix(sent[-1])[:2, 0] == pytest.approx([np.cos(angle), np.sin(angle)])


def test_without_tf2_msgs_there_is_the_description_alone(no_tf2):
    node = FakeNode()
    frames = CellFrames(node, SimpleNamespace(draft=DRAFT))
    frames.turn(0, 0.0)
    assert frames.state == 'no tf2_msgs'
    assert list(node.sent) == ['robot_description']
    assert len(node.sent['robot_description']) == 1


def test_transforms_are_left_to_robot_state_publisher_where_it_runs(tf2):
    node = FakeNode(publish_tf=False)
    assert CellFrames(node, SimpleNamespace(draft=DRAFT)).state == 'off'
    assert list(node.sent) == ['robot_description']


def test_description_and_fixed_transforms_are_latched():
    for topic in ('robot_description', '/tf_static'):
        assert qos.of_topic(topic).durability is qos.DurabilityPolicy.TRANSIENT_LOCAL
    assert qos.of_topic('/tf').durability is qos.DurabilityPolicy.VOLATILE
