# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of RViz and Foxglove name topics, types, QoS and frames that the nodes have."""

import json
from pathlib import Path
import re

import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.qos import ReliabilityPolicy
import yaml

from ivfmc_ros.cell.urdf import BASE
from ivfmc_ros.cell.urdf import TABLE
from ivfmc_ros.nodes.framework import qos

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = (ROOT / 'docs/reference/topics.md').read_text(encoding='utf-8')
NAMESPACE = '/ivfmc/'
FRAMES = {BASE, TABLE, 'camera_optical_frame'}
# Message type of each display of RViz.
DISPLAYS = {
    'PointCloud2': 'sensor_msgs/PointCloud2',
    'Marker': 'visualization_msgs/Marker',
    'Image': 'sensor_msgs/CompressedImage',
    'RobotModel': 'std_msgs/String',
}


def type_of(topic):
    """The message type of a topic of the namespace, as the reference has it."""
    name = re.escape(topic.removeprefix(NAMESPACE))
    found = re.search(rf'\| publishes [^|]*`{name}`[^|]*\| (\w+/\w+) \|', REFERENCE)
    return found[1] if found else None


def rviz():
    return yaml.safe_load((ROOT / 'config/cell.rviz').read_text())['Visualization Manager']


def displays():
    for display in rviz()['Displays']:
        topic = display.get('Topic') or display.get('Description Topic')
        if topic:
            yield display['Class'].rpartition('/')[2], topic


@pytest.mark.parametrize(('kind', 'topic'), list(displays()), ids=lambda item: str(item)[:40])
def test_displays_of_rviz_receive_what_the_nodes_publish(kind, topic):
    name = topic['Value']
    assert name.startswith(NAMESPACE)
    assert type_of(name) == DISPLAYS[kind]
    offered = qos.of_topic(name)
    latched = offered.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert topic['Durability Policy'] == ('Transient Local' if latched else 'Volatile')
    assert topic['Reliability Policy'] == 'Reliable'
    assert offered.reliability is ReliabilityPolicy.RELIABLE


def test_frames_of_rviz_are_those_of_the_cell():
    manager = rviz()
    named = {manager['Global Options']['Fixed Frame'], manager['Views']['Current']['Target Frame']}
    named |= {display.get('Reference Frame', TABLE) for display in manager['Displays']}
    assert named <= FRAMES
    assert {kind for kind, _ in displays()} == set(DISPLAYS)


def foxglove():
    return json.loads((ROOT / 'config/cell.foxglove.json').read_text())


def panels(layout):
    """The panels of a layout, left to right and from the top down."""
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column')
    assert 0 < layout['splitPercentage'] < 100
    return panels(layout['first']) + panels(layout['second'])


def test_layout_of_foxglove_shows_each_panel_once():
    layout = foxglove()
    shown = panels(layout['layout'])
    assert sorted(shown) == sorted(layout['configById'])
    assert [name.partition('!')[0] for name in shown] == [
        '3D', 'Image', 'DiagnosticSummary', 'RawMessages',
    ]  # fmt: skip


def test_panels_of_foxglove_name_topics_and_frames_of_the_cell():
    config = foxglove()['configById']
    scene = config['3D!cell']
    assert {name: type_of(name) for name in scene['topics']} == {
        '/ivfmc/profile': 'sensor_msgs/PointCloud2',
        '/ivfmc/cloud': 'sensor_msgs/PointCloud2',
        '/ivfmc/mesh': 'visualization_msgs/Marker',
    }
    assert type_of(scene['layers']['cell']['topic']) == 'std_msgs/String'
    assert {scene['followTf'], scene['layers']['grid']['frameId']} <= FRAMES
    image = config['Image!stripe']['imageMode']['imageTopic']
    assert type_of(image) == 'sensor_msgs/CompressedImage'
    assert type_of(config['RawMessages!status']['topicPath']) == (
        'diagnostic_msgs/DiagnosticStatus'
    )
    assert config['DiagnosticSummary!nodes']['topicToRender'] == '/diagnostics'
