# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans delete``, ``restore`` and ``empty-trash``."""

from pathlib import Path

import click

from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.storage.archive import trash
from ivfmc_ros.storage.catalogue.search import ScanFilter

_yes_option = click.option('--yes', is_flag=True, help='Do not ask.')


@click.command()
@click.argument('scan_ids', metavar='SCAN_ID...', nargs=-1, required=True)
@catalogue_options
@_yes_option
def delete(scan_ids: tuple[str, ...], root: Path, url: str, yes: bool) -> None:
    """Move scans to the trash; `ivfmc scans restore` undoes it until the trash is emptied."""
    catalogue = open_catalogue(root, url)
    # an unknown id is refused before anything is moved
    rows = [catalogue.scan(scan_id) for scan_id in scan_ids]
    names = ', '.join(row.scan_id for row in rows)
    if not yes:
        click.confirm(f'Move {names} to the trash?', abort=True)
    for scan_id in scan_ids:
        target = trash.delete_scan(catalogue, scan_id)
        console().print(f'{scan_id}: is in the trash, {target}', soft_wrap=True)


@click.command()
@click.argument('scan_ids', metavar='SCAN_ID...', nargs=-1, required=True)
@catalogue_options
def restore(scan_ids: tuple[str, ...], root: Path, url: str) -> None:
    """Take scans back from the trash."""
    catalogue = open_catalogue(root, url)
    for scan_id in scan_ids:
        target = trash.restore_scan(catalogue, scan_id)
        console().print(f'{scan_id}: is back, {target}', soft_wrap=True)


@click.command('empty-trash')
@catalogue_options
@_yes_option
def empty_trash(root: Path, url: str, yes: bool) -> None:
    """Delete the scans in the trash for good."""
    catalogue = open_catalogue(root, url)
    found = catalogue.find(ScanFilter(deleted=True))
    if not found:
        console().print('the trash is empty')
        return
    if not yes:
        click.confirm(f'Delete {len(found)} scans for good?', abort=True)
    for scan_id in trash.empty_trash(catalogue):
        console().print(f'{scan_id}: deleted')
