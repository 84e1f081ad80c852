# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans export``, ``import`` and ``report``: scans as ZIP files, reports as PDF."""

from pathlib import Path

import click

from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.inspection.reports.pdf import print_pdf
from ivfmc_ros.scan.recipe_verdict import INSPECTION_PAGE
from ivfmc_ros.scan.report import REPORT_PAGE
from ivfmc_ros.storage.archive.packages import export_scan
from ivfmc_ros.storage.archive.packages import import_scan


@click.command()
@click.argument('scan_id')
@catalogue_options
@click.option(
    '-o', '--output', type=click.Path(path_type=Path),
    help='ZIP file to write.  [default: SCAN_ID.zip]',
)  # fmt: skip
@click.option(
    '--without-pictures', is_flag=True,
    help='Leave the camera pictures out of the bag; profiles, views and results stay.',
)  # fmt: skip
def export(
    scan_id: str, root: Path, url: str, output: Path | None, without_pictures: bool
) -> None:
    """Write a scan with its bag, calibration and results to one ZIP file with hashes."""
    row = open_catalogue(root, url).scan(scan_id)
    target = output or Path(f'{row.scan_id}.zip')
    manifest = export_scan(row, target, pictures=not without_pictures)
    size = target.stat().st_size / 1e6
    console().print(f'{target}: {len(manifest["files"])} files, {size:.1f} MB', soft_wrap=True)


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
