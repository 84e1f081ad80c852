# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc up``: starts a cell, one process for each node, and ends all of them together."""

from collections.abc import Iterator
import contextlib
from contextlib import contextmanager
from pathlib import Path
import signal
import threading
from typing import Any
from typing import TextIO

import click

from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import make_folder
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.cli.support.cell_run import OF_HARDWARE
from ivfmc_ros.cli.support.cell_run import parse_overrides
from ivfmc_ros.cli.support.cell_run import start
from ivfmc_ros.cli.support.cell_run import WINDOW
from ivfmc_ros.cli.support.cell_run import write_simulated
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.cli.support.processes import Say
from ivfmc_ros.cli.support.shared_memory import remove_dead_segments
from ivfmc_ros.cli.support.sole_cell import sole_cell
from ivfmc_ros.cli.support.supervision import Supervisor
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.environment import config_file

_PATH = click.Path(path_type=Path)
_WIDTH = max(len(name) for name in NODES)
_POLL_S = 0.1


@click.command()
@click.option(
    '--simulate',
    is_flag=True,
    help='Simulate the hardware of --cell and --camera, or of the bench cell.',
)
@click.option(
    '--replay',
    is_flag=True,
    help='Start without camera, turntable and orchestrator: a bag replaces them.',
)
@click.option(
    '--folder',
    type=_PATH,
    default=Path('ivfmc_run'),
    show_default=True,
    help='Folder of this run: log, cell.urdf, calibration of a simulated cell.',
)
@click.option('--scans', type=_PATH, help='Folder of the scans (default: FOLDER/scans).')
@click.option('--config', type=_PATH, help='Folder with <node>.yaml (default: the bench cell).')
@click.option(
    '--recipes',
    type=_PATH,
    help='Folder of the recipes (default: FOLDER/recipes, where it exists).',
)
@click.option('--cell', type=_PATH, help='cell.yaml of the cell.')
@click.option('--camera', type=_PATH, help='camera.yaml, where the driver has none.')
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
@click.option(
    '--part', default='demo', show_default=True, help='Simulated part: demo or an STL file.'
)
@click.option('--unit', default='mm', show_default=True, help='Unit of the STL file.')
@click.option(
    '--seed', type=int, default=0, show_default=True, help='Seed of the simulated noise.'
)
@click.option(
    '--home-switch',
    is_flag=True,
    help='Simulate a table with a home switch, which is locked until it is homed.',
)
@click.option(
    '--on-exit',
    type=click.Choice(('restart', 'stop')),
    default='restart',
    show_default=True,
    help='What follows when a node ends or hangs: start it again (later each time, at most 5 '
    'times within 10 minutes), or stop the cell.',
)
@click.option(
    '--window',
    is_flag=True,
    help='Serve the work window to browsers of this computer, on port 8088 (window.port).',
)
@click.option(
    '--set',
    'overrides',
    multiple=True,
    metavar='NODE.NAME=VALUE',
    help='Parameter of a node; may be repeated.',
)
def up(**options: Any) -> None:
    """Start a cell and keep it up until Ctrl-C."""
    run = run_of(options)
    with cell_client(run.namespace) as client, log_of(run) as say, sole_cell(client):
        freed = remove_dead_segments()
        if freed:
            say('up', f'removed {freed / 1e6:.0f} MB of shared memory of processes that died')
        processes = Processes(say)
        restart = options['on_exit'] == 'restart'
        supervisor = Supervisor(run, processes, client, say, restart=restart)
        try:
            with processes, interrupted() as ending:
                _keep_up(run, processes, client, supervisor, say, ending)
        finally:
            supervisor.reset_after_end()
            remove_dead_segments()


def _keep_up(
    run: CellRun,
    processes: Processes,
    client: CellClient,
    supervisor: Supervisor,
    say: Say,
    ending: threading.Event,
) -> None:
    """:raises HelperError: a process of the cell has ended or hangs."""
    try:
        start(run, processes)
        say('up', f'{len(run.nodes)} nodes under {run.namespace}; Ctrl-C ends them')
        while not ending.is_set():
            client.spin(_POLL_S)
            supervisor.check()
    except ScanError as error:
        supervisor.say_end(error.code, str(error))
        raise
    say('up', 'ending')
    supervisor.say_end('INTERRUPTED', 'ivfmc up was ended by Ctrl-C or a signal')


def run_of(options: dict[str, Any]) -> CellRun:
    """
    Return the run that the options ask for; calibration of a simulated cell is written.

    :raises ScanError: options contradict each other, or a file is missing
    """
    simulate, replay = options['simulate'], options['replay']
    if simulate and replay:
        raise ParameterError('--simulate and --replay exclude each other')
    if options['home_switch'] and not simulate:
        raise ParameterError('--home-switch is of the simulated table; it needs --simulate')
    folder: Path = options['folder']
    cell, camera = options['cell'], options['camera']
    if simulate:
        if bool(cell) != bool(camera):
            raise ParameterError(
                '--simulate needs both --cell and --camera, or neither for the bench cell'
            )
        cell, camera = write_simulated(folder, cell, camera)
    if cell is None:
        raise ParameterError('--cell cell.yaml is needed, unless the cell is simulated')
    for path in (cell, camera):
        if path is not None and not path.is_file():
            raise FileError(f'{path}: no such file')
    make_folder(folder)
    return CellRun(
        folder=folder,
        scans=options['scans'] or folder / 'scans',
        config=options['config'] or config_file('bench/orchestrator.yaml').parent,
        cell=cell,
        camera=camera,
        namespace=namespace_of(options['namespace']),
        simulate=simulate,
        nodes=[
            *(name for name in NODES if not (replay and name in OF_HARDWARE)),
            *((WINDOW,) if options['window'] else ()),
        ],
        part=options['part'],
        unit=options['unit'],
        seed=options['seed'],
        home_switch=options['home_switch'],
        recipes=_recipes(folder, options['recipes']),
        overrides=parse_overrides(options['overrides']),
    )


def _recipes(folder: Path, given: Path | None) -> Path | None:
    found = given or folder / 'recipes'
    if found.is_dir():
        return found
    if given is not None:
        raise FileError(f'{given}: no such folder')
    return None


@contextmanager
def log_of(run: CellRun, quiet: bool = False) -> Iterator[Say]:
    """
    Write the output of all processes to ``up.log``, and to the terminal unless ``quiet``.

    :raises FileError: it cannot be written
    """
    try:
        stream: TextIO = (run.folder / 'up.log').open('a', encoding='utf-8')
    except OSError as error:
        raise FileError(f'{run.folder}: cannot be written: {error.strerror or error}') from error
    with stream:

        def say(name: str, line: str) -> None:
            text = f'{name:>{_WIDTH}} | {line}'
            # a full disk must neither silence the terminal nor end the cell
            with contextlib.suppress(OSError, ValueError):
                stream.write(text + '\n')
                stream.flush()
            with contextlib.suppress(OSError):
                if not quiet:
                    click.echo(text)

        yield say


@contextmanager
def interrupted() -> Iterator[threading.Event]:
    """Yield an event that SIGINT, SIGTERM and SIGHUP set; the former handlers are restored."""
    event = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: event.set()) for number in numbers}
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
