# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc demo``: starts a simulated cell, calls its scan service, compares mesh and CAD."""

from collections.abc import Callable
from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.cli.scan import run_scan
from ivfmc_ros.cli.scan import say
from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.cli.support.cell_run import start
from ivfmc_ros.cli.support.cell_run import write_simulated
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.cli.support.sole_cell import sole_cell
from ivfmc_ros.cli.up import log_of
from ivfmc_ros.errors import HelperError
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.reports.deviation_image import write_deviation_image
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.inspection.sampled_mesh import mesh_deviation
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.meshing.io.stl import read_stl
from ivfmc_ros.nodes.framework.environment import config_file
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.surface import Surface

_COMING_UP_S = 120.0
# Seconds to wait for the rendered report, which ends with the cell.
_REPORT_S = 600.0
# Meters at which the colors of deviation.png saturate: five times the rms that is expected.
_SPAN = 1e-4


def run_graph(output: Path, seed: int, wanted: Mapping[str, Any]) -> None:
    """
    Scan the demo part in a simulated cell into a new folder.

    wanted : parameters of the scan
    :raises ScanError: the folder exists, a cell is up already, or the scan fails
    """
    files.require_new_folder(output)
    output.mkdir(parents=True, exist_ok=True)
    cell, camera = write_simulated(output)
    run = CellRun(
        folder=output,
        scans=output / 'scans',
        config=config_file('bench/orchestrator.yaml').parent,
        cell=cell,
        camera=camera,
        simulate=True,
        seed=seed,
    )
    part = demo_part()
    write_solid(output / 'nominal.stl', part.vertices_xyz, part.faces)
    with (
        cell_client(NAMESPACE) as client,
        sole_cell(client),
        log_of(run, quiet=True) as log,
        Processes(log) as processes,
    ):
        begin = time.monotonic()
        start(run, processes)
        _await_cell(client, processes)
        up = time.monotonic()
        result = run_scan(client, dict(wanted), _alive(processes))
        seconds = {'start': up - begin, 'scan': time.monotonic() - up}
        _await_report(client, result, _alive(processes))
    vertices, faces = read_stl(Path(result['files']['mesh.stl']))
    nominal = Surface(part.vertices_xyz, part.faces)
    deviation = mesh_deviation(vertices, faces, nominal)
    write_report(
        output / 'demo.json',
        {'deviation_m': {'mesh': vars(deviation)}, 'seconds': seconds, 'scan': result},
    )
    write_deviation_image(
        output / 'deviation.png', Surface(vertices, faces), vertices, nominal, _SPAN
    )
    say(result)
    _say_deviation(output, deviation, seconds)


def _await_cell(client: CellClient, processes: Processes) -> None:
    alive = _alive(processes)
    with client.heartbeats() as received:

        def up() -> bool:
            alive()
            return bool(client.status) and received().issuperset(NODES)

        # on a loaded machine the slowest node takes much longer to import than the orchestrator
        client.until(up, _COMING_UP_S, 'all nodes to come up')


def _await_report(
    client: CellClient, result: Mapping[str, Any], alive: Callable[[], None]
) -> None:
    def rendered() -> bool:
        alive()
        return bool(client.status.get('report') or client.status.get('report_error'))

    if result.get('report_pending'):
        client.until(rendered, _REPORT_S, 'the report to be rendered')


def _alive(processes: Processes) -> Callable[[], None]:
    """Return a check that raises when a process of the cell has ended."""

    def check() -> None:
        gone = processes.ended()
        if gone is not None:
            raise HelperError('NODE_DIED', f'{gone}; see up.log')

    return check


def _say_deviation(output: Path, deviation: Deviation, seconds: Mapping[str, float]) -> None:
    stdout = console()
    stdout.print(
        f'mesh to CAD: rms {deviation.rms * 1e3:.4f} mm, 95 % within {deviation.p95 * 1e3:.4f} mm'
    )
    stdout.print(f'cell up in {seconds["start"]:.1f} s, scan in {seconds["scan"]:.1f} s')
    for name in ('deviation.png', 'nominal.stl', 'demo.json', 'up.log'):
        stdout.print(str(output / name), soft_wrap=True)
