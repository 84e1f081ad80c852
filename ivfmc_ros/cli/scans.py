# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans``: what is in the catalogue."""

import math
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ivfmc_ros.cli.support.source import scans_option
from ivfmc_ros.storage.catalogue import Catalogue


@click.group()
def scans() -> None:
    """List and show the scans of a folder."""


@scans.command('list')
@scans_option
@click.option('--part', help='Only scans of this part.')
def list_scans(root: Path, part: str | None) -> None:
    """List the scans, the oldest first."""
    catalogue = Catalogue(root)
    table = Table()
    # somebody copies it from here
    table.add_column('scan', no_wrap=True)
    for name in ('part', 'created', 'stage', 'code', 'views', 'profiles'):
        table.add_column(name)
    for row in catalogue.scans():
        if part is None or row.part == part:
            views = catalogue.views(row.scan_id)
            table.add_row(
                row.scan_id,
                row.part,
                row.created,
                row.stage,
                row.code,
                str(len(views)),
                str(sum(view.profiles for view in views)),
            )
    Console(markup=False).print(table)


@scans.command()
@click.argument('scan_id')
@scans_option
def show(scan_id: str, root: Path) -> None:
    """Show one scan: parameters, views, results, files."""
    catalogue = Catalogue(root)
    row = catalogue.scan(scan_id)
    console = Console(highlight=False, markup=False)
    console.print(f'{row.scan_id}  {row.stage} {row.code}  {row.created}')
    for key, value in row.parameters.items():
        console.print(f'  {key}: {value}')
    table = Table('view', 'laser', 'profiles', 'points', 'from', 'to')
    for view in catalogue.views(scan_id):
        table.add_row(
            *map(str, (view.view, view.laser, view.profiles, view.points)),
            f'{math.degrees(view.first_angle):.2f}°',
            f'{math.degrees(view.last_angle):.2f}°',
        )
    console.print(table)
    for result in catalogue.results(scan_id):
        console.print(f'result {result.number} of {result.created}: {result.folder}')
    if row.folder.is_dir():
        for path in sorted(row.folder.iterdir()):
            console.print(str(path), soft_wrap=True)
