# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scan``: calls the scan service and shows its progress."""

from collections.abc import Callable
import math
from typing import Any

import click
from rich.progress import BarColumn
from rich.progress import Progress as Bars
from rich.progress import TextColumn

from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.client import error_of
from ivfmc_ros.cli.support.client import result_of
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.progress import ProgressLines
from ivfmc_ros.cli.support.quantities import angle
from ivfmc_ros.cli.support.quantities import duration
from ivfmc_ros.cli.support.quantities import length
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.meshing.io.export import FORMATS
from ivfmc_ros.scan.request import MAX_WARM_UP_S
from ivfmc_ros.scan.request import MOTIONS
from ivfmc_ros.scan.view_coverage import MIN_SPACING

# Seconds after which a status has to come, at the latest with the result.
_STATUS_S = 20.0
# Seconds in which the orchestrator reads the bag of an interrupted scan, at the latest.
_LOAD_S = 300.0
# Seconds without a heartbeat of the orchestrator after which it is gone.
_SILENCE_S = 5.0


@click.command()
@click.option('--part', help='Name of the part.')
@click.option(
    '--recipe',
    help='Name of a recipe of the cell; what it sets is stronger than the options here.',
)
@click.option('--views', type=int, help='Sweeps a turn, for each laser.')
@click.option('--overlap', type=angle(0.0, math.pi), help='By which neighboring sweeps overlap.')
@click.option(
    '--closure',
    type=angle(0.0, math.pi),
    help='By which a scan with one laser exceeds the turn, to show lost steps; 0: not.',
)
@click.option('--profiles', type=int, help='Profiles of each view.')
@click.option(
    '--max-spacing',
    type=length(MIN_SPACING, 1.0),
    help='Of neighboring profiles on the part, such as 0.3mm; where they are farther apart, the '
    'angles are taken again in finer steps.',
)
@click.option('--motion', type=click.Choice(MOTIONS), help='How the table turns.')
@click.option(
    '--dark-frames/--no-dark-frames',
    default=None,
    help='Subtract a picture with all lasers off (step).',
)
@click.option(
    '--exposure',
    'exposures',
    type=duration(1e-6, 1.0),
    multiple=True,
    help='Exposure time, such as 2ms; repeated, ascending: each sweep is taken with each of them.',
)
@click.option(
    '--warm-up',
    type=duration(0.0, MAX_WARM_UP_S),
    help='Longest time, such as 120s, for which a laser waits until its stripe no longer moves.',
)
@click.option(
    '--laser', 'lasers', multiple=True, help='Laser to use; may be repeated (default: all).'
)
@click.option(
    '--format',
    'formats',
    multiple=True,
    type=click.Choice(FORMATS),
    help='Mesh file format; may be repeated.',
)
@click.option(
    '--resume',
    'resumed',
    metavar='SCAN_ID',
    help='Go on with a scan that was interrupted, with its own values; no other option is taken.',
)
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
@json_option
def scan(namespace: str, as_json: bool, resumed: str | None, **options: Any) -> None:
    """
    Scan a part in the cell that is up.

    An option that is not given has the value that the orchestrator has. What is given holds for
    this scan only. --resume takes what is missing of a scan that was interrupted; the part must
    not have been touched since.
    """
    wanted = wanted_of(options)
    if resumed is not None and wanted:
        raise ParameterError(
            f'--resume: the scan goes on with its own values; leave out {", ".join(wanted)}'
        )
    with cell_client(namespace_of(namespace)) as client:
        result = run_scan(client, wanted) if resumed is None else resume_scan(client, resumed)
    if as_json:
        print_json(result)
    else:
        say(result)


def wanted_of(options: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters that were given, as the orchestrator takes them."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in options.items()
        if value not in (None, ())
    }


def run_scan(
    client: CellClient, wanted: dict[str, Any], check: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """
    Scan, with progress on stderr; Ctrl-C cancels the scan and waits for its end.

    wanted : parameters of this scan only; the orchestrator's own are restored
    check : is called again and again; it raises when the scan cannot go on
    :raises HelperError: the scan was refused or failed, with its code
    """
    with client.parameters('orchestrator', wanted):
        # the orchestrator takes the parameters as they are now for the whole scan
        scan_id = client.trigger('start_scan')['scan_id']
    return _follow(client, scan_id, check)


def resume_scan(client: CellClient, scan_id: str) -> dict[str, Any]:
    """
    Go on with a scan that was interrupted, with progress as ``run_scan``.

    :raises HelperError: it cannot be resumed, or failed, with its code
    """
    # the status of its interruption is latched; it must not be taken for its end
    client.until(lambda: bool(client.status), _STATUS_S, 'scan_status')
    with client.parameters('orchestrator', {'resume_scan': scan_id}):
        client.status = {}
        # the orchestrator reads the whole bag before it answers
        client.trigger('resume', _LOAD_S)
    return _follow(client, scan_id, lambda: None)


def _follow(client: CellClient, scan_id: str, check: Callable[[], None]) -> dict[str, Any]:
    with ScanBar() as show, interrupted() as ending:
        cancelled = False
        while (result := result_of(client.status, scan_id)) is None:
            client.until(_changed(client), _STATUS_S, 'scan_status')
            check()
            show(client.status)
            if ending.is_set() and not cancelled:
                cancelled = True
                _cancel(client)
    if result['code'] != 'OK':
        raise error_of(result)
    return result


def _cancel(client: CellClient) -> None:
    try:
        client.trigger('cancel')
    except HelperError as error:
        # it may just have ended, and its result is on the way
        if error.code != StateError.code:
            raise


def _changed(client: CellClient) -> Callable[[], bool]:
    before = client.status

    def changed() -> bool:
        if client.silent_s > _SILENCE_S:
            raise HelperError(
                'ORCHESTRATOR_LOST',
                f'the orchestrator gives no heartbeat for {client.silent_s:.0f} s: it ended '
                'without a word, or the network is down; the scan folder keeps what was taken',
            )
        return client.status is not before

    return changed


class ScanBar:
    """Shows ``scan_status`` on stderr while the block runs: one bar, or lines."""

    def __init__(self) -> None:
        stderr = console(stderr=True)
        self._lines = None if stderr.is_terminal else ProgressLines(stderr)
        columns = (
            TextColumn('{task.fields[stage]:>11}'),
            BarColumn(),
            TextColumn(
                'view {task.fields[views]}  profile {task.fields[profiles]}  '
                'about {task.fields[eta]} s left'
            ),
        )
        self._bars = Bars(*columns, console=stderr, transient=True)
        self._task = self._bars.add_task('scan', total=1, stage='', views='', profiles='', eta='?')

    def __enter__(self) -> Callable[[dict[str, str]], None]:
        if self._lines is None:
            self._bars.start()
        return self._show

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def _show(self, status: dict[str, str]) -> None:
        if not status.get('profiles_total'):
            return
        if self._lines is not None:
            done = f'{status["profiles_done"]} of {status["profiles_total"]} profiles'
            left = f'about {float(status["eta_s"]):.0f} s left'
            self._lines.line(status['stage'], f'{status["stage"]}: {done}, {left}')
            return
        self._bars.update(
            self._task,
            completed=int(status['profiles_done']),
            total=int(status['profiles_total']),
            stage=status['stage'],
            views=f'{status["views_done"]}/{status["views_total"]}',
            profiles=f'{status["profiles_done"]}/{status["profiles_total"]}',
            eta=f'{float(status["eta_s"]):.0f}',
        )


def say(result: dict[str, Any]) -> None:
    """Print the result of a scan and where its files are."""
    stdout = console()
    counts, seconds = result['counts'], sum(result['seconds'].values())
    stdout.print(
        f'scan {result["scan_id"]}: {counts["profiles"]} profiles in {counts["views"]} view(s), '
        f'{counts["points"]} points, {seconds:.1f} s',
    )
    if result.get('detail'):
        stdout.print(result['detail'])
    if result.get('verdict'):
        inspection = result['inspection']
        reason = f' ({inspection["reason"]})' if inspection.get('reason') else ''
        stdout.print(f'verdict: {result["verdict"]}{reason}', soft_wrap=True)
    for name, path in result['files'].items():
        if not name.endswith(('.json', '.yaml')) or name == 'report.json':
            stdout.print(path, soft_wrap=True)
    if result.get('report_pending'):
        stdout.print('mesh.png and report.html are being rendered there', soft_wrap=True)
