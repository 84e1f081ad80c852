# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cell as processes: which nodes there are, and what each is started with."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
import re
import sys
from typing import Any

import yaml

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.urdf import write_urdf
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.framework import environment
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_thickness

NODES = (
    'turntable',
    'camera',
    'triangulator',
    'registrar',
    'mesher',
    'recorder',
    'orchestrator',
)
# A bag stands in for these.
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
    overrides: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def simulation(self) -> Path:
        """Where the simulated cell keeps its board and its truth."""
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
            f'--namespace {text!r}: must be of letters, digits and _, its parts parted by /'
        )
    return name


def write_bench(folder: Path) -> tuple[Path, Path]:
    """
    Write the calibration of the simulated bench cell and return cell.yaml and camera.yaml.

    :raises FileError: it cannot be written
    """
    make_folder(folder)
    cell = with_thickness(bench_cell(), Optics())
    save_cell(folder / 'cell.yaml', cell)
    save_camera(folder / 'camera.yaml', cell.camera)
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
    if run.simulate:
        processes.start(SIMULATION, _simulation(run), around, ready='ready')
    for node in run.nodes:
        processes.start(node, command(run, node), around)


def command(run: CellRun, node: str) -> list[str]:
    """Return the command line of a node."""
    words = [sys.executable, '-m', f'ivfmc_ros.nodes.{node}', '--ros-args']
    words += ['-r', f'__ns:={run.namespace}']
    file = run.config / f'{node}.yaml'
    if file.is_file():
        words += ['--params-file', str(file)]
    for name, value in {**_own(run, node), **run.overrides.get(node, {})}.items():
        words += ['-p', f'{name}:={_text(value)}']
    return words


def _own(run: CellRun, node: str) -> dict[str, Any]:
    """Return the parameters that follow from where this run is."""
    cell = str(run.cell.absolute())
    found: dict[str, dict[str, Any]] = {
        'triangulator': {'cell': cell},
        'registrar': {'cell': cell},
        'mesher': {'cell': cell},
        'orchestrator': {'cell': cell, 'scan_root': str(run.scans.absolute())},
    }
    table = load_draft(run.cell).turntable
    if table is not None:
        found['orchestrator']['joint'] = table.joint
        found['turntable'] = {'joint': table.joint}
    if run.camera is not None:
        found['camera'] = {'camera_info': str(run.camera.absolute())}
    if run.simulate:
        place = str(run.simulation.absolute())
        found.setdefault('camera', {}).update({'backend': 'simulated', 'simulation': place})
        found.setdefault('turntable', {})['port'] = f'{place}/board'
    return found.get(node, {})


def _simulation(run: CellRun) -> list[str]:
    words = [sys.executable, '-m', f'ivfmc_ros.simulation.{SIMULATION}']
    words += ['--folder', str(run.simulation.absolute()), '--seed', str(run.seed)]
    words += ['--part', run.part]
    return words if run.part == 'demo' else [*words, '--unit', run.unit]


def _text(value: Any) -> str:
    """Return a value as the YAML that a command line takes."""
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).split('\n...')[0].strip()


def parse_overrides(items: Sequence[str]) -> dict[str, dict[str, Any]]:
    """
    Read parameters that are given as node.name=value.

    :raises ParameterError: one is not of this form
    """
    found: dict[str, dict[str, Any]] = {}
    for item in items:
        place, equals, text = item.partition('=')
        node, dot, name = place.partition('.')
        if not (equals and dot and name) or node not in NODES:
            raise ParameterError(
                f'--set {item!r}: must be node.parameter=value; nodes are {", ".join(NODES)}'
            )
        try:
            found.setdefault(node, {})[name] = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ParameterError(f'--set {item!r}: {error}') from error
    return found
