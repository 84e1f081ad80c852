# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc merge``: several clampings of one part become one mesh."""

from pathlib import Path
from typing import Any

import click

from ivfmc_ros import files
from ivfmc_ros.cli.reconstruct import say
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.reconstruction_options import reconstruction_options
from ivfmc_ros.cli.support.reconstruction_options import settings_of
from ivfmc_ros.cli.support.source import bag_of
from ivfmc_ros.cli.support.source import open_bag
from ivfmc_ros.cli.support.source import source_options
from ivfmc_ros.pipeline import clamping_of
from ivfmc_ros.pipeline import join
from ivfmc_ros.pipeline import measure
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.merge import require_several
from ivfmc_ros.results import write_results
from ivfmc_ros.storage.stored_scan import retrieve


@click.command()
@click.argument('sources', nargs=-1, metavar='SCAN SCAN...')
@source_options
@reconstruction_options
def merge(
    sources: tuple[str, ...], cell_path: Path | None, output: Path, root: Path, **options: Any
) -> None:
    """
    Bring several clampings of one part together, and build one mesh of them.

    SCAN is a scan id of the catalogue or a bag: the same part, put onto the table in another way,
    such as lying. No first guess is needed. The mesh is where the first scan has the part. A part
    that looks the same in several poses is refused, and the motions between them are named.
    """
    settings = settings_of(options)
    require_several(sources)
    files.require_new_folder(output)
    clampings = [_clamping(source, root, cell_path, settings) for source in sources]
    with progress_bars() as progress:
        made = join(clampings, settings, progress)
    cell = clampings[0].cell
    say(output, write_results(output, cell, made, ' + '.join(sources), {}))


def _clamping(source: str, root: Path, cell_path: Path | None, settings: Settings) -> Clamping:
    bag = bag_of(source)
    if bag is not None:
        scan, cell = open_bag(bag, cell_path, None)
        with progress_bars() as progress:
            profiles = measure(cell, scan.frames(), settings, scan.frame_count, progress)
    else:
        profiles, cell = retrieve(root, source, cell_path)
    return clamping_of(source, cell, profiles, settings)
