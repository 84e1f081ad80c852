# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scan``: calls the scan service and shows how far it is."""

from collections.abc import Callable
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn
from rich.progress import Progress as Bars
from rich.progress import TextColumn

from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.client import error_of
from ivfmc_ros.cli.support.client import result_of
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import StateError
from ivfmc_ros.meshing.io.export import FORMATS
from ivfmc_ros.scan.request import MOTIONS

# A node that answers nothing for so long is gone.
_SILENCE_S = 20.0


@click.command()
@click.option('--part', help='Name of the part.')
@click.option('--recipe', help='Name of the recipe.')
@click.option('--views', type=int, help='Sweeps that share a turn, for each laser.')
@click.option('--overlap', type=float, metavar='RAD', help='By which sweeps share surface.')
@click.option('--profiles', type=int, help='Of each view.')
@click.option('--motion', type=click.Choice(MOTIONS), help='How the table turns.')
@click.option(
    '--dark-frames/--no-dark-frames',
    default=None,
    help='Subtract a picture with all lasers off (step).',
)
@click.option('--laser', 'lasers', multiple=True, help='To use; may be repeated (default: all).')
@click.option('--format', 'formats', multiple=True, type=click.Choice(FORMATS), help='Of meshes.')
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
def scan(namespace: str, **options: Any) -> None:
    """Scan a part in the cell that is up; what is not given stays as the orchestrator has it."""
    wanted = wanted_of(options)
    with cell_client(namespace_of(namespace)) as client:
        result = run_scan(client, wanted)
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
    Scan, with a bar on the terminal; Ctrl-C cancels the scan and waits for its end.

    check : is called again and again, and raises when it makes no sense to go on
    :raises HelperError: the scan was refused or failed, with its code
    """
    if wanted:
        client.set('orchestrator', wanted)
    scan_id = client.trigger('start_scan')['scan_id']
    with ScanBar() as show, interrupted() as ending:
        cancelled = False
        while (result := result_of(client.status, scan_id)) is None:
            client.until(_changed(client), _SILENCE_S, 'scan_status')
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
    return lambda: client.status is not before


class ScanBar:
    """Shows ``scan_status`` as one line while the block runs."""

    def __init__(self) -> None:
        columns = (
            TextColumn('{task.fields[stage]:>11}'),
            BarColumn(),
            TextColumn(
                'view {task.fields[views]}  profile {task.fields[profiles]}  '
                'about {task.fields[eta]} s left'
            ),
        )
        self._bars = Bars(*columns, console=Console(stderr=True), transient=True)
        self._task = self._bars.add_task('scan', total=1, stage='', views='', profiles='', eta='?')

    def __enter__(self) -> Callable[[dict[str, str]], None]:
        self._bars.start()
        return self._show

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def _show(self, status: dict[str, str]) -> None:
        if not status.get('profiles_total'):
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
    """Print what came of a scan and where it is."""
    console = Console(markup=False)
    counts, seconds = result['counts'], sum(result['seconds'].values())
    console.print(
        f'scan {result["scan_id"]}: {counts["profiles"]} profiles in {counts["views"]} view(s), '
        f'{counts["points"]} points, {seconds:.1f} s',
        highlight=False,
    )
    for name, path in result['files'].items():
        if not name.endswith(('.json', '.yaml')) or name == 'report.json':
            console.print(path, soft_wrap=True, highlight=False)
