# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The launch files of config/ are consistent: arguments, included files, names of nodes and topics.

Without an installation of ROS they cannot be started.
"""

import json
import re

import pytest
from support import launch_files as launch
from support.foreign_camera import DRIVERS
from support.house import ROOT
import yaml

FILES = launch.launch_files()
FOREIGN = [path for path in FILES if path.name != 'cell.launch.xml']
CAMERAS = ('usb_cam', 'v4l2_camera', 'camera_aravis2')
every_file = pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
every_camera = pytest.mark.parametrize('name', CAMERAS)


def topics() -> set[str]:
    """Names in the interface table of the reference."""
    page = (ROOT / 'docs/reference/topics.md').read_text(encoding='utf-8')
    rows = [line.split('|')[1] for line in page.splitlines() if line.startswith('|')]
    return {name for row in rows for name in re.findall(r'`([^`]+)`', row)}


def test_all_launch_files_are_found():
    names = {path.name.removesuffix('.launch.xml') for path in FILES}
    assert names == {'cell', *CAMERAS, 'joint_trajectory_controller'}


@every_file
def test_every_argument_that_is_used_is_declared_and_described(path):
    root = launch.load(path)
    assert launch.used_arguments(root) == set(launch.arguments(root))
    assert [
        item.attrib['name'] for item in root.findall('arg') if not item.get('description')
    ] == []


@every_file
def test_included_files_exist_and_get_what_they_need(path):
    for include in launch.load(path).iter('include'):
        included = launch.arguments(launch.load(launch.included_file(include)))
        given = {item.attrib['name'] for item in include.findall('arg')}
        assert given <= set(included)
        # the launcher refuses an include that lacks one, also where the command line has it
        assert {name for name, default in included.items() if default is None} <= given


@every_file
def test_files_of_this_package_exist(path):
    text = path.read_text(encoding='utf-8')
    places = re.findall(r'\$\(find-pkg-share ivfmc_ros\)/([^"\s)]+)', text)
    assert [place for place in places if not (ROOT / place).exists()] == []


@every_file
def test_our_nodes_exist_and_declare_the_parameters(path):
    declared = json.loads((launch.CONFIG / 'parameters.json').read_text(encoding='utf-8'))
    for node in launch.load(path).iter('node'):
        if node.attrib['pkg'] != 'ivfmc_ros':
            continue
        assert (ROOT / 'resource/executables' / node.attrib['exec']).is_file()
        names = {item.attrib['name'] for item in node.findall('param') if 'name' in item.attrib}
        assert names <= set(declared[node.attrib['exec']])


@every_camera
def test_parameters_of_a_camera_driver_are_those_that_it_declares(name):
    (node,) = launch.load(launch.CONFIG / f'{name}.launch.xml').iter('node')
    assert node.attrib['pkg'] == name
    names = {item.attrib['name'] for item in node.findall('param')}
    resolved = {text.replace('$(var namespace)', 'ivfmc') for text in names}
    assert resolved <= DRIVERS[name].parameters


@every_camera
def test_images_of_a_camera_driver_arrive_on_the_topics_of_the_cell(name):
    renamed = launch.remappings(f'{name}.launch.xml')
    assert set(renamed) <= set(DRIVERS[name].topics)
    arriving = {renamed.get(topic, topic) for topic in DRIVERS[name].topics}
    assert arriving == {'image_raw', 'camera_info'}
    assert arriving <= topics()


def test_controller_is_remapped_by_names_of_the_interface():
    renamed = launch.remappings('joint_trajectory_controller.launch.xml', 'set_remap')
    assert set(renamed) == {'joint_trajectory', 'joint_states'}
    assert set(renamed) <= topics()
    text = (launch.CONFIG / 'ros2_control.yaml').read_text(encoding='utf-8')
    controllers = set(yaml.safe_load(text)) - {'controller_manager'}
    assert renamed['joint_trajectory'].split('/')[1] in controllers
    path = launch.CONFIG / 'joint_trajectory_controller.launch.xml'
    (spawner,) = [n for n in launch.load(path).iter('node') if n.attrib['exec'] == 'spawner']
    assert controllers <= set(spawner.attrib['args'].split())


@pytest.mark.parametrize('path', FOREIGN, ids=lambda path: path.name)
def test_page_of_the_drivers_lists_the_launch_file_with_its_arguments(path):
    page = (ROOT / 'docs/how-to/foreign-drivers.md').read_text(encoding='utf-8')
    assert f'ros2 launch ivfmc_ros {path.name}' in page
    names = launch.arguments(launch.load(path))
    assert [name for name in names if f'`{name}`' not in page] == []
