# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans export``, ``import`` and ``report``: scans as ZIP, clouds as PLY, PDF."""

from pathlib import Path

import click

from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.reports.pdf import print_pdf
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.io.export import write_cloud
from ivfmc_ros.results import merged_points
from ivfmc_ros.scan.recipe_verdict import INSPECTION_PAGE
from ivfmc_ros.scan.report import REPORT_PAGE
from ivfmc_ros.storage.archive.packages import export_scan
from ivfmc_ros.storage.archive.packages import import_scan
from ivfmc_ros.storage.scans.scan_contents import registered_views

_PACKAGE, _CLOUD = '.zip', '.ply'


@click.command()
@click.argument('scan_id')
@catalogue_options
@click.option(
    '-o', '--output', type=click.Path(path_type=Path),
    help='File to write: .zip, or .ply for the cloud of points alone.  [default: SCAN_ID.zip]',
)  # fmt: skip
@click.option(
    '--without-pictures', is_flag=True,
    help='Leave the camera pictures out of the bag; profiles, views and results stay.',
)  # fmt: skip
@click.option('--unit', type=click.Choice(list(UNITS)), default='mm', show_default=True,
              help='Of a PLY file.')  # fmt: skip
def export(
    scan_id: str, root: Path, url: str, output: Path | None, without_pictures: bool, unit: str
) -> None:
    """
    Write a scan with its bag, calibration and results to one ZIP file with hashes.

    With -o FILE.ply, the points of its registered views with sigma, 1 standard deviation of
    each, in the frame of the table.
    """
    row = open_catalogue(root, url).scan(scan_id)
    target = output or Path(f'{row.scan_id}.zip')
    if target.suffix == _CLOUD:
        if without_pictures:
            raise ParameterError(f'--without-pictures: {target} has no pictures')
        _export_cloud(row.folder, target, unit)
        return
    if target.suffix != _PACKAGE:
        raise ParameterError(f'{target}: must end with {_PACKAGE} or {_CLOUD}')
    manifest = export_scan(row, target, pictures=not without_pictures)
    size = target.stat().st_size / 1e6
    console().print(f'{target}: {len(manifest["files"])} files, {size:.1f} MB', soft_wrap=True)


def _export_cloud(folder: Path, target: Path, unit: str) -> None:
    """:raises FileError: the file exists, or cannot be written."""
    if target.exists():
        raise FileError(f'{target}: exists already and is not overwritten')
    points, sigma = merged_points(*registered_views(folder))
    write_cloud(target, points, sigma, unit)
    console().print(f'{target}: {len(points)} points, {unit}', soft_wrap=True)


@click.command('import')
@click.argument('packages', nargs=-1, required=True, type=click.Path(path_type=Path))
@catalogue_options
def import_packages(packages: tuple[Path, ...], root: Path, url: str) -> None:
    """Take scans from ZIP files of `ivfmc scans export`; every file is checked by its hash."""
    catalogue = open_catalogue(root, url, create=True)
    for package in packages:
        made = import_scan(catalogue, package)
        console().print(f'{made.scan_id}: {made.profiles} profiles, {made.results} results')


@click.command()
@click.argument('scan_id')
@catalogue_options
@click.option('--inspection', is_flag=True, help='The report of the inspection by its recipe.')
@click.option(
    '-o', '--output', type=click.Path(path_type=Path),
    help='PDF file to write; an existing one is replaced.  [default: SCAN_ID.pdf]',
)  # fmt: skip
def report(scan_id: str, root: Path, url: str, inspection: bool, output: Path | None) -> None:
    """Print the report of a scan to a PDF file of at most four A4 pages; needs Chromium."""
    row = open_catalogue(root, url).scan(scan_id)
    target = output or Path(f'{row.scan_id}.pdf')
    print_pdf(row.folder / (INSPECTION_PAGE if inspection else REPORT_PAGE), target)
    console().print(str(target), soft_wrap=True)
