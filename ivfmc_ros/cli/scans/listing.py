# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans list`` and ``show``."""

import csv
from dataclasses import asdict
from io import StringIO
import math
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import filter_of
from ivfmc_ros.cli.scans.options import filter_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.storage.catalogue.calibrations import certificates
from ivfmc_ros.storage.catalogue.rows import FeatureRow
from ivfmc_ros.storage.catalogue.rows import FoundScan

_COLUMNS = ('part', 'created', 'stage', 'code', 'verdict', 'views', 'profiles')
_MM = 1e3
_DIGITS = 12  # of a SHA-256 that are shown


@click.command('list')
@catalogue_options
@filter_options
@click.option('--trash', 'deleted', is_flag=True, help='The deleted scans instead of the others.')
@click.option('--newest', type=click.IntRange(0), default=0, help='Only so many, the newest.')
@json_option
@click.option('--csv', 'as_csv', is_flag=True, help='Print comma-separated values.')
def list_scans(
    root: Path,
    url: str,
    deleted: bool,
    newest: int,
    as_json: bool,
    as_csv: bool,
    **options: Any,
) -> None:
    """List the scans, the oldest first."""
    catalogue = open_catalogue(root, url)
    found = catalogue.find(filter_of(options, deleted=deleted, newest=newest))
    rows = [_summary(scan) for scan in found]
    if as_json:
        print_json(rows)
    elif as_csv:
        click.echo(_csv(rows), nl=False)
    else:
        console().print(_table(found))


def _summary(scan: FoundScan) -> dict[str, Any]:
    row = asdict(scan)
    value = row.pop('value')
    if value is not None:
        row |= {
            'feature': value['feature'],
            'characteristic': value['characteristic'],
            **{f'{name}_m': value[name] for name in ('nominal', 'measured', 'tolerance')},
            'U_m': value['uncertainty'],
            'feature_verdict': value['verdict'],
        }
    return row


def _csv(rows: list[dict[str, Any]]) -> str:
    stream = StringIO()
    writer = csv.DictWriter(stream, list(rows[0]) if rows else [], lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _table(found: list[FoundScan]) -> Table:
    table = Table()
    # a scan id is copied from here: it must stay in one piece
    table.add_column('scan', no_wrap=True)
    has_cells = len({scan.cell for scan in found}) > 1
    columns = (*(('cell',) if has_cells else ()), *_COLUMNS)
    values = [scan.value for scan in found if scan.value]
    for name in (*columns, *(('characteristic', 'mm', 'U', 'judged') if values else ())):
        table.add_column(name)
    for scan in found:
        cells = [str(getattr(scan, name)) for name in columns]
        table.add_row(scan.scan_id, *cells, *(_measured(scan.value) if scan.value else ()))
    return table


def _measured(value: FeatureRow) -> tuple[str, ...]:
    numbers = [
        '' if number is None else f'{number * _MM:.4f}'
        for number in (value.measured, value.uncertainty)
    ]
    return (value.characteristic, *numbers, value.verdict)


@click.command()
@click.argument('scan_id')
@catalogue_options
@json_option
def show(scan_id: str, root: Path, url: str, as_json: bool) -> None:
    """
    Show one scan: parameters, views, results, measured features, files.

    SCAN_ID may be CELL/SCAN_ID where several cells have a scan of that id.
    """
    catalogue = open_catalogue(root, url)
    row = catalogue.scan(scan_id)
    views, results = catalogue.views(scan_id), catalogue.results(scan_id)
    features, tests = catalogue.features(scan_id), certificates(catalogue, scan_id)
    files = sorted(row.folder.iterdir()) if row.folder.is_dir() else []
    if as_json:
        document = {key: value for key, value in asdict(row).items() if key != 'key'}
        document |= {
            'views': [asdict(view) for view in views],
            'results': [asdict(result) for result in results],
            'features': [asdict(feature) for feature in features],
            'certificates': [asdict(test) for test in tests],
            'files': [str(path) for path in files],
        }
        print_json(document)
        return
    stdout = console()
    stdout.print(f'{row.scan_id}  {row.stage} {row.code} {row.verdict}  {row.created}  {row.cell}')
    for key, value in row.parameters.items():
        stdout.print(f'  {key}: {value}')
    if row.calibration:
        checks = ', '.join(f'{test.verdict} on {test.created}' for test in tests)
        stdout.print(
            f'calibration {row.calibration[:_DIGITS]}, acceptance test: {checks or "none"}'
        )
    table = Table('view', 'laser', 'profiles', 'points', 'from', 'to')
    for view in views:
        table.add_row(
            *map(str, (view.view, view.laser, view.profiles, view.points)),
            f'{math.degrees(view.first_angle):.2f}°',
            f'{math.degrees(view.last_angle):.2f}°',
        )
    stdout.print(table)
    if features:
        measured = Table('feature', 'characteristic', 'mm', 'U', 'judged')
        for feature in features:
            measured.add_row(feature.feature, *_measured(feature))
        stdout.print(measured)
    for result in results:
        stdout.print(f'result {result.number} of {result.created}: {result.folder}')
    for path in files:
        stdout.print(str(path), soft_wrap=True)
