# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The processes of a cell: its nodes, and the command line of each."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
import difflib
import json
from pathlib import Path
import re
import sys
from typing import Any

import yaml

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.urdf import write_urdf
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.framework import environment
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.laser_outputs import LASER_OUTPUTS
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness

NODES = (
    'turntable',
    'camera',
    'triangulator',
    'registrar',
    'mesher',
    'recorder',
    'orchestrator',
)
# A node that the cell can do without.
WINDOW = 'window'
# `ivfmc up --replay` starts without these: a bag replaces them.
OF_HARDWARE = ('turntable', 'camera', 'orchestrator')
NAMESPACE = '/ivfmc'
SIMULATION = 'live_cell'

_NAMESPACE = re.compile(r'/|(/[A-Za-z_][A-Za-z0-9_]*)+')


@dataclass(frozen=True, kw_only=True)
class CellRun:
    """
    What a cell is started with.

    folder : of this run: calibration of a simulated cell, log
    scans : folder of the scans
    config : folder with <node>.yaml
    cell : cell.yaml; camera : camera.yaml, or None where the driver has its own
    simulate : the hardware is a simulated one
    nodes : which are started
    part, unit : what stands on the table of a simulated cell: an STL file and its unit
    home_switch : the simulated table has one, and is locked until it is homed
    recipes : folder of the recipes, or None
    overrides : parameters by node, stronger than the files
    """

    folder: Path
    scans: Path
    config: Path
    cell: Path
    camera: Path | None = None
    namespace: str = NAMESPACE
    simulate: bool = False
    nodes: Sequence[str] = NODES
    part: str = 'demo'
    unit: str = 'mm'
    seed: int = 0
    home_switch: bool = False
    recipes: Path | None = None
    overrides: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def simulation(self) -> Path:
        """Folder of the simulated cell: port of its controller, ground truth."""
        return self.folder / 'simulation'


def make_folder(folder: Path) -> None:
    """:raises FileError: it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f'{folder}: cannot be made: {error.strerror or error}') from error


def namespace_of(text: str) -> str:
    """
    Return the namespace of a cell that a user names, such as /ivfmc.

    :raises ParameterError: it cannot be one
    """
    name = '/' + text.strip('/')
    if not _NAMESPACE.fullmatch(name):
        raise ParameterError(
            f'--namespace {text!r}: must consist of letters, digits and _, separated by /'
        )
    return name


def write_simulated(
    folder: Path, cell: Path | None = None, camera: Path | None = None
) -> tuple[Path, Path]:
    """
    Write the calibration of a simulated cell and return cell.yaml and camera.yaml.

    cell, camera : files of the cell to simulate, by default the bench cell; the thickness of its
        light sheets is that of the simulated lasers
    :raises CellError: a file is not valid, or the cell has too many lasers
    :raises FileError: a file cannot be read or written
    """
    make_folder(folder)
    found = load_cell(cell, load_camera(camera)) if cell and camera else bench_cell()
    if len(found.lasers) > LASER_OUTPUTS:
        raise CellError(
            f'{cell}: lasers: the simulated controller has {LASER_OUTPUTS} outputs, the cell has '
            f'{len(found.lasers)} lasers'
        )
    found = with_sheet_thickness(found, Optics())
    save_cell(folder / 'cell.yaml', found)
    save_camera(folder / 'camera.yaml', found.camera)
    return folder / 'cell.yaml', folder / 'camera.yaml'


def start(run: CellRun, processes: Processes) -> None:
    """
    Start the processes of a cell.

    :raises ScanError: a file is missing, or a process does not come up
    """
    write_urdf(run.folder / 'cell.urdf', load_draft(run.cell))
    around = environment.child_environment(
        PYTHONUNBUFFERED='1',
        RCUTILS_LOGGING_USE_STDOUT='1',
        RCUTILS_LOGGING_BUFFERED_STREAM='0',
        RCUTILS_CONSOLE_OUTPUT_FORMAT='[{severity}] {message}',
        ROS_LOG_DIR=str(run.folder / 'log'),
    )
    # that of this process is not that of the nodes
    around.pop('ROS_SECURITY_ENCLAVE_OVERRIDE', None)
    if run.simulate:
        processes.start(SIMULATION, _simulation(run), around, ready='ready')
    for node in run.nodes:
        processes.start(node, command(run, node), around)


def command(run: CellRun, node: str) -> list[str]:
    """Return the command line of a node."""
    words = [sys.executable, '-m', f'ivfmc_ros.nodes.{node}', '--ros-args']
    words += ['-r', f'__ns:={run.namespace}']
    # by which SROS2 finds the permissions of the node; without SROS2 it means nothing
    words += ['--enclave', f'{run.namespace.rstrip("/")}/{node}']
    file = run.config / f'{node}.yaml'
    if file.is_file():
        words += ['--params-file', str(file)]
    for name, value in {**own_parameters(run, node), **run.overrides.get(node, {})}.items():
        words += ['-p', f'{name}:={_text(value)}']
    return words


def own_parameters(run: CellRun, node: str) -> dict[str, Any]:
    """Return the parameters that follow from where this run is."""
    cell, root = str(run.cell.absolute()), str(run.scans.absolute())
    found: dict[str, dict[str, Any]] = {
        'triangulator': {'cell': cell},
        'registrar': {'cell': cell, 'scan_root': root},
        'mesher': {'cell': cell, 'scan_root': root},
        'recorder': {'scan_root': root},
        'orchestrator': {'cell': cell, 'scan_root': root},
    }
    found[WINDOW] = {'cell': cell, 'scan_root': root}
    found[WINDOW]['pictures'] = str((run.folder / 'calibration_pictures').absolute())
    if run.recipes is not None:
        for name in ('orchestrator', WINDOW):
            found[name]['recipe_root'] = str(run.recipes.absolute())
    table = load_draft(run.cell).turntable
    if table is not None:
        found['orchestrator']['joint'] = found[WINDOW]['joint'] = table.joint
        found['turntable'] = {'joint': table.joint}
    if run.camera is not None:
        found['camera'] = {'camera_info': str(run.camera.absolute())}
        found[WINDOW]['camera'] = str(run.camera.absolute())
    if run.simulate:
        place = str(run.simulation.absolute())
        found.setdefault('camera', {}).update({'backend': 'simulated', 'simulation': place})
        if table is not None and table.trigger_step:
            # a scan switches it on for each sweep
            found['camera'].update({'trigger': 'table', 'triggered': False})
        found.setdefault('turntable', {})['port'] = f'{place}/controller'
    return found.get(node, {})


def _simulation(run: CellRun) -> list[str]:
    words = [sys.executable, '-m', f'ivfmc_ros.simulation.{SIMULATION}']
    words += ['--folder', str(run.simulation.absolute()), '--seed', str(run.seed)]
    words += ['--cell', str(run.cell.absolute())]
    if run.camera is not None:
        words += ['--camera', str(run.camera.absolute())]
    words += ['--part', run.part]
    if run.home_switch:
        words.append('--homing')
    return words if run.part == 'demo' else [*words, '--unit', run.unit]


def _text(value: Any) -> str:
    """Return a value as the YAML that a command line takes."""
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).split('\n...')[0].strip()


def parse_overrides(items: Sequence[str]) -> dict[str, dict[str, Any]]:
    """
    Read parameters that are given as node.name=value.

    :raises ParameterError: one is not of this form, or the node does not declare it
    """
    found: dict[str, dict[str, Any]] = {}
    for item in items:
        place, equals, text = item.partition('=')
        node, dot, name = place.partition('.')
        known = (*NODES, WINDOW)
        if not (equals and dot and name) or node not in known:
            raise ParameterError(
                f'--set {item!r}: must be node.parameter=value; nodes are {", ".join(known)}'
            )
        _require_declared(item, node, name)
        try:
            found.setdefault(node, {})[name] = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ParameterError(f'--set {item!r}: {error}') from error
    return found


def _require_declared(item: str, node: str, name: str) -> None:
    """Refuse a parameter that the node would not know, before the cell is started."""
    declared = json.loads(environment.config_file('parameters.json').read_text(encoding='utf-8'))
    known = [*declared[node], 'use_sim_time']
    if name in known or name.startswith('qos_overrides.'):
        return
    similar = difflib.get_close_matches(name, known, n=1)
    hint = f'; did you mean {node}.{similar[0]}?' if similar else ''
    raise ParameterError(f'--set {item!r}: {node} has no parameter {name}{hint}')
