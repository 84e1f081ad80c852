# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc merge``: registers several clampings of one part and builds one mesh."""

from pathlib import Path
from typing import Any

import click

from ivfmc_ros import files
from ivfmc_ros.cli.reconstruct import say
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.reconstruction_options import reconstruction_options
from ivfmc_ros.cli.support.reconstruction_options import settings_of
from ivfmc_ros.cli.support.source import bag_of
from ivfmc_ros.cli.support.source import bag_options_of
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.cli.support.source import source_options
from ivfmc_ros.pipeline import measure_profiles
from ivfmc_ros.pipeline import reconstruct_clampings
from ivfmc_ros.pipeline import register_clamping
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.merge import require_several
from ivfmc_ros.results import write_results
from ivfmc_ros.storage.scans.stored_scan import load_profiles


@click.command()
@click.argument('sources', nargs=-1, metavar='SCAN SCAN...')
@source_options
@reconstruction_options
def merge(
    sources: tuple[str, ...], cell_path: Path | None, output: Path, root: Path, **options: Any
) -> None:
    """
    Register several clampings of one part, and build one mesh.

    SCAN is a scan id of the catalogue or a bag: the same part, clamped in another way, such as
    lying. No first guess is needed. The mesh is in the frame of the first scan. A part that fits
    in several poses is refused, and the motions between them are described.
    """
    settings = settings_of(options)
    require_several(sources)
    files.require_new_folder(output)
    reading = bag_options_of(options)
    clampings = [_clamping(source, root, cell_path, settings, reading) for source in sources]
    with progress_bars() as progress:
        made = reconstruct_clampings(clampings, settings, progress)
    cell = clampings[0].cell
    say(output, write_results(output, cell, made, ' + '.join(sources), {}))


def _clamping(
    source: str, root: Path, cell_path: Path | None, settings: Settings, reading: BagOptions
) -> Clamping:
    bag = bag_of(source)
    if bag is not None:
        scan, cell = read_scan(bag, cell_path, None, reading)
        with progress_bars() as progress:
            profiles = measure_profiles(cell, scan.frames(), settings, scan.frame_count, progress)
    else:
        profiles, cell = load_profiles(root, source, cell_path)
    return register_clamping(source, cell, profiles, settings)
