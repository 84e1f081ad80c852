# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans``: lists and shows the scans of a catalogue."""

from dataclasses import asdict
import math
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.source import scans_option
from ivfmc_ros.cli.support.suggest import SuggestingGroup
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import ScanRow


@click.group(cls=SuggestingGroup)
def scans() -> None:
    """List and show the scans of a folder."""


@scans.command('list')
@scans_option
@click.option('--part', help='Only scans of this part.')
@json_option
def list_scans(root: Path, part: str | None, as_json: bool) -> None:
    """List the scans, the oldest first."""
    catalogue = Catalogue(root)
    rows = [
        _summary(catalogue, row) for row in catalogue.scans() if part is None or row.part == part
    ]
    if as_json:
        print_json(rows)
        return
    table = Table()
    # a scan id is copied from here: it must stay in one piece
    table.add_column('scan', no_wrap=True)
    for name in ('part', 'created', 'stage', 'code', 'views', 'profiles'):
        table.add_column(name)
    for row in rows:
        table.add_row(*map(str, row.values()))
    console().print(table)


def _summary(catalogue: Catalogue, row: ScanRow) -> dict[str, Any]:
    views = catalogue.views(row.scan_id)
    return {
        'scan_id': row.scan_id,
        'part': row.part,
        'created': row.created,
        'stage': row.stage,
        'code': row.code,
        'views': len(views),
        'profiles': sum(view.profiles for view in views),
    }


@scans.command()
@click.argument('scan_id')
@scans_option
@json_option
def show(scan_id: str, root: Path, as_json: bool) -> None:
    """Show one scan: parameters, views, results, files."""
    catalogue = Catalogue(root)
    row = catalogue.scan(scan_id)
    views, results = catalogue.views(scan_id), catalogue.results(scan_id)
    files = sorted(row.folder.iterdir()) if row.folder.is_dir() else []
    if as_json:
        print_json(
            {
                **_summary(catalogue, row),
                'parameters': row.parameters,
                'views': [asdict(view) for view in views],
                'results': [asdict(result) for result in results],
                'files': [str(path) for path in files],
            }
        )
        return
    stdout = console()
    stdout.print(f'{row.scan_id}  {row.stage} {row.code}  {row.created}')
    for key, value in row.parameters.items():
        stdout.print(f'  {key}: {value}')
    table = Table('view', 'laser', 'profiles', 'points', 'from', 'to')
    for view in views:
        table.add_row(
            *map(str, (view.view, view.laser, view.profiles, view.points)),
            f'{math.degrees(view.first_angle):.2f}°',
            f'{math.degrees(view.last_angle):.2f}°',
        )
    stdout.print(table)
    for result in results:
        stdout.print(f'result {result.number} of {result.created}: {result.folder}')
    for path in files:
        stdout.print(str(path), soft_wrap=True)
