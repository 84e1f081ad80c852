# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc reconstruct``: a bag in, a mesh out, without a ROS graph."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ivfmc_ros import files
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cli.batch.run import make_jobs
from ivfmc_ros.cli.batch.run import run_batch
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import pdf_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.reconstruction_options import reconstruction_options
from ivfmc_ros.cli.support.reconstruction_options import settings_of
from ivfmc_ros.cli.support.source import bag_of
from ivfmc_ros.cli.support.source import bag_options_of
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.cli.support.source import source_options
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.reports.pdf import find_browser
from ivfmc_ros.pipeline import reconstruct as run
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Reconstruction
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import write_results
from ivfmc_ros.scan.title_block import source_texts
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.scans.scan_bag import ScanBag
from ivfmc_ros.storage.scans.stored_scan import load_profiles
from ivfmc_ros.stripe.opencv_threads import use_one_thread


@click.command()
@click.argument('sources', metavar='BAG|SCAN_ID...', nargs=-1, required=True)
@source_options
@click.option(
    '--camera',
    'camera_path',
    type=click.Path(path_type=Path),
    help='Camera calibration to use instead of the one in the bag.',
)
@click.option(
    '--jobs',
    type=click.IntRange(1, 1024),
    default=1,
    show_default=True,
    help='Of several bags, reconstruct so many at once, each in a process.',
)
@click.option(
    '--dask',
    default='',
    metavar='ADDRESS',
    help='Reconstruct on a Dask cluster, such as tcp://host:8786, whose workers see the same '
    'folders.',
)
@reconstruction_options
@pdf_option
@json_option
def reconstruct(
    sources: tuple[str, ...],
    cell_path: Path | None,
    camera_path: Path | None,
    output: Path,
    root: Path,
    jobs: int,
    dask: str,
    pdf: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """
    Rebuild a part, or many.

    BAG is a bag folder, the folder of an interrupted scan, or an .mcap, .db3 or .bag file; its
    pictures are measured again.
    SCAN_ID is a scan of the catalogue; its stored points are read from its bag.
    Of several sources, each has a folder below the output; results that are there already are
    kept, and one that fails does not end the others.
    """
    settings = settings_of(options)
    reading = bag_options_of(options)
    if pdf:
        find_browser()
    if len(sources) > 1 or jobs > 1 or dask:
        if pdf:
            raise ParameterError('--pdf: is for one BAG or SCAN_ID')
        made_jobs = make_jobs(
            sources,
            output,
            settings,
            reading,
            root=root,
            cell_path=cell_path,
            camera_path=camera_path,
        )
        run_batch(made_jobs, processes=jobs, dask=dask, as_json=as_json)
        return
    [source] = sources
    files.require_new_folder(output)
    bag = bag_of(source)
    if bag is not None:
        scan, cell = read_scan(bag, cell_path, camera_path, reading)
        made, skipped = _measure(scan, cell, settings), scan.skipped
    else:
        made, cell, skipped = _from_catalogue(root, source, cell_path, camera_path, settings)
    heading = source_texts(_folder_of(bag, root, source), cell_path)
    document = write_results(output, cell, made, source, skipped, pdf=pdf, heading=heading)
    if bag is None:
        counts = {**document['counts'], 'residuals': document['residuals']}
        Catalogue(root).add_result(source, str(output.absolute()), {'counts': counts})
    if as_json:
        print_json(document)
    else:
        say(output, document)
    require_right(document)


def _folder_of(bag: Path | None, root: Path, source: str) -> Path:
    """Return the folder of a bag, or that of a scan of the catalogue."""
    if bag is None:
        return Catalogue(root).scan(source).folder
    return bag if bag.is_dir() else bag.parent


def require_right(document: Mapping[str, Any]) -> None:
    """
    Accept a result whose views agree.

    :raises HelperError: they do not; the files are kept
    """
    if document.get('code', 'OK') != 'OK':
        raise HelperError(document['code'], f'{document["code"]}: {document["detail"]}')


def _measure(scan: ScanBag, cell: Cell, settings: Settings) -> Reconstruction:
    use_one_thread()
    with progress_bars() as progress:
        return run(cell, scan.frames(), settings, scan.frame_count, progress)


def _from_catalogue(
    root: Path,
    scan_id: str,
    cell_path: Path | None,
    camera_path: Path | None,
    settings: Settings,
) -> tuple[Reconstruction, Cell, Mapping[str, int]]:
    profiles, cell = load_profiles(root, scan_id, cell_path, camera_path)
    with progress_bars() as progress:
        return reconstruct_profiles(cell, profiles, settings, progress), cell, {}


def say(output: Path, document: Mapping[str, Any]) -> None:
    """Print the result and where its files are."""
    stdout = console()
    counts = document['counts']
    seconds = sum(document['seconds'].values())
    stdout.print(
        f'{counts["pictures"]} pictures, {counts["kept_points"]} points in {counts["views"]} '
        f'view(s), mesh of {counts["faces"]} triangles in {seconds:.1f} s'
    )
    for reason, count in counts['skipped'].items():
        stdout.print(f'{count} picture(s) not used: {reason}')
    for name, figures in document.get('deviation_m', {}).items():
        stdout.print(
            f'{name} to CAD: rms {figures["rms"] * 1e3:.4f} mm, '
            f'95 % within {figures["p95"] * 1e3:.4f} mm'
        )
    for line in _table_lines(document):
        stdout.print(line)
    for subject in ('volume', 'sheets', 'lasers'):
        if advice := document.get(subject, {}).get('advice'):
            stdout.print(advice)
    for placed in document.get('merge', [])[1:]:
        stdout.print(
            f'{placed["name"]} placed on {", ".join(placed["onto"])}: {placed["overlap"]:.0%} '
            f'overlap, rms {placed["rms"] * 1e3:.4f} mm, 1 sigma {placed["sigma"] * 1e3:.4f} mm'
        )
    for name in (
        'mesh.stl',
        'mesh.png',
        'cloud.png',
        'stripes.png',
        'report.html',
        'report.pdf',
        'report.json',
    ):
        if (output / name).exists():
            stdout.print(str(output / name), soft_wrap=True)


def _table_lines(document: Mapping[str, Any]) -> list[str]:
    """Return what the check of the table found beside its code."""
    table = document.get('table', {})
    lines = [f'not checked: {document["detail"]}'] if table.get('code') == 'UNCHECKED' else []
    return lines + [f'{key}: {table[key]}' for key in ('drift', 'triggers') if table.get(key)]
