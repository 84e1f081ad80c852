# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc reconstruct``: a bag in, a mesh out, without a ROS graph."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ivfmc_ros import files
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cli.progress import progress_bars
from ivfmc_ros.cli.settings import reconstruction_options
from ivfmc_ros.cli.settings import settings_of
from ivfmc_ros.pipeline import reconstruct as run
from ivfmc_ros.results import write_results
from ivfmc_ros.storage.scan_bag import read_scan


@click.command()
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--cell',
    'cell_path',
    type=click.Path(path_type=Path),
    required=True,
    help='cell.yaml: lasers and turntable.',
)
@click.option(
    '--camera',
    'camera_path',
    type=click.Path(path_type=Path),
    help='Camera calibration to use instead of the one in the bag.',
)
@click.option(
    '-o',
    '--output',
    type=click.Path(path_type=Path),
    required=True,
    help='Folder to make; must not exist yet.',
)
@reconstruction_options
def reconstruct(
    bag: Path, cell_path: Path, camera_path: Path | None, output: Path, **options: Any
) -> None:
    """Rebuild a part from BAG: a folder with metadata.yaml, or an .mcap file."""
    settings = settings_of(options)
    files.require_new_folder(output)
    draft = load_draft(cell_path)
    camera = None if camera_path is None else load_camera(camera_path)
    names = [laser.name for laser in draft.lasers]
    scan = read_scan(bag, lasers=names, camera=camera)
    cell = draft.complete(scan.camera, str(cell_path))
    with progress_bars() as progress:
        made = run(cell, scan.frames(), settings, scan.frame_count, progress)
    say(output, write_results(output, cell, made, str(bag), scan.skipped))


def say(output: Path, document: Mapping[str, Any]) -> None:
    """Print what came out and where it is."""
    console = Console()
    counts = document['counts']
    seconds = sum(document['seconds'].values())
    console.print(
        f'{counts["pictures"]} pictures, {counts["kept_points"]} points in {counts["views"]} '
        f'view(s), mesh of {counts["faces"]} triangles in {seconds:.1f} s'
    )
    for reason, count in counts['skipped'].items():
        console.print(f'{count} picture(s) not used: {reason}')
    for name, figures in document.get('deviation_m', {}).items():
        console.print(
            f'{name} to CAD: rms {figures["rms"] * 1e3:.4f} mm, '
            f'95 % within {figures["p95"] * 1e3:.4f} mm'
        )
    for name in ('mesh.stl', 'mesh.png', 'cloud.png', 'stripes.png', 'report.json'):
        console.print(str(output / name), soft_wrap=True, highlight=False)
