# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The launch file of a cell starts its nodes with parameters that these declare.

The package launch is not needed: the Python file runs with a stand-in of what it imports.
"""

import json
from pathlib import Path
import re
import runpy
import sys
from types import ModuleType
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.cli.support.cell_run import OF_HARDWARE
from ivfmc_ros.cli.support.cell_run import own_parameters
from ivfmc_ros.cli.support.cell_run import WINDOW

CONFIG = Path(__file__).resolve().parents[1] / 'config'
XML = ElementTree.parse(CONFIG / 'cell.launch.xml').getroot()
DECLARED = json.loads((CONFIG / 'parameters.json').read_text())
OURS = {node.get('exec'): node for node in XML.iter('node') if node.get('pkg') == 'ivfmc_ros'}


def texts():
    """All attributes in which arguments may be used."""
    return [value for element in XML.iter() for value in element.attrib.values()]


def test_every_node_of_a_cell_is_started():
    assert set(OURS) == {*NODES, WINDOW}
    assert all(node.get('name') == name for name, node in OURS.items())
    assert all(node.get('namespace') == '$(var namespace)' for node in OURS.values())


@pytest.mark.parametrize('name', sorted(OURS))
def test_parameters_are_those_that_the_node_declares(name):
    given = [param.get('name') for param in OURS[name].findall('param') if param.get('name')]
    assert [item for item in given if item not in DECLARED[name]] == []
    files = [param.get('from') for param in OURS[name].findall('param') if param.get('from')]
    for path in files:
        assert (CONFIG / 'bench' / path.rpartition('/')[2]).is_file()


def test_arguments_are_described_and_used():
    arguments = {item.get('name'): item for item in XML.findall('arg')}
    assert all(item.get('description') for item in arguments.values())
    used = set(re.findall(r'\$\(var (\w+)\)', ' '.join(texts())))
    assert used == set(arguments)
    # a let overrides an argument, and no name of its own
    assert {item.get('name') for item in XML.findall('let')} <= set(arguments)
    assert {'simulate', 'replay', 'window', 'rviz', 'namespace'} <= set(arguments)


def test_a_bag_replaces_the_same_nodes_as_in_the_command():
    set_off = {item.get('name') for item in XML.findall('let') if item.get('value') == 'false'}
    conditions = {name: node.get('if') or node.get('unless') for name, node in OURS.items()}
    assert set_off == {'camera', 'turntable'}
    assert all(conditions[name] == f'$(var {name})' for name in set_off)
    assert OURS['orchestrator'].get('unless') == '$(var replay)'
    assert {*set_off, 'orchestrator'} == set(OF_HARDWARE)


def test_simulation_is_started_as_by_the_command(tmp_path):
    from ivfmc_ros.cell.cell_file import save_cell
    from ivfmc_ros.cli.support.cell_run import CellRun
    from ivfmc_ros.simulation.bench import bench_cell

    save_cell(tmp_path / 'cell.yaml', bench_cell())
    run = CellRun(
        folder=tmp_path, scans=tmp_path, config=CONFIG, cell=tmp_path / 'cell.yaml', simulate=True
    )
    place = str(run.simulation.absolute())
    lets = {
        item.get('name'): item.get('value').replace('$(var simulation)', place)
        for item in XML.findall('let')
        if item.get('if') == '$(var simulate)'
    }
    assert lets['port'] == own_parameters(run, 'turntable')['port']
    assert lets['backend'] == own_parameters(run, 'camera')['backend']
    (process,) = XML.findall('executable')
    assert process.get('if') == '$(var simulate)'
    words = process.get('cmd').split()
    from ivfmc_ros.simulation import live_cell

    assert words[:3] == ['python3', '-m', live_cell.__name__]
    source = Path(live_cell.__file__).read_text()
    assert all(f"'{word}'" in source for word in words if word.startswith('--'))


@pytest.fixture
def launch(monkeypatch):
    """A stand-in of the package launch, as far as the Python file needs it."""
    names = {
        'launch': {'LaunchDescription': lambda entities: entities},
        'launch.actions': {
            'DeclareLaunchArgument': lambda name: name,
            'IncludeLaunchDescription': lambda source, launch_arguments: (
                source.path,
                dict(launch_arguments),
            ),
        },
        'launch.launch_description_sources': {
            'AnyLaunchDescriptionSource': lambda path: SimpleNamespace(path=path)
        },
        'launch.substitutions': {'LaunchConfiguration': lambda name: f'value of {name}'},
    }
    for name, values in names.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)


def test_python_file_is_the_xml_file(launch):
    """Nodes and defaults cannot differ: there is one file that has them."""
    made = runpy.run_path(str(CONFIG / 'cell.launch.py'))['generate_launch_description']()
    required = [item.get('name') for item in XML.findall('arg') if item.get('default') is None]
    # what the include demands: an argument without a default is not found in it otherwise
    *declared, (path, handed_on) = made
    assert Path(path) == CONFIG / 'cell.launch.xml'
    assert declared == required == ['cell']
    assert handed_on == {name: f'value of {name}' for name in required}
