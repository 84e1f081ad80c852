# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc demo``: the whole job in a simulated cell, compared with the CAD."""

from pathlib import Path
from typing import Any

import click

from ivfmc_ros.cli.support.reconstruction_options import reconstruction_options
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.request import MOTIONS


@click.command()
@click.option(
    '-o',
    '--output',
    type=click.Path(path_type=Path),
    default=Path('demo'),
    show_default=True,
    help='Folder to make; must not exist yet.',
)
@click.option('--offline', is_flag=True, help='Pictures to a bag to a mesh, without ROS.')
@click.option(
    '--steps',
    '--profiles',
    'steps',
    type=click.IntRange(8, 4000),
    default=200,
    show_default=True,
    help='Profiles a turn, for each of the two lasers.',
)
@click.option(
    '--motion',
    type=click.Choice(MOTIONS),
    default='continuous',
    show_default=True,
    help='How the table turns (not offline).',
)
@click.option(
    '--speckle',
    type=click.FloatRange(0.0, 1.0),
    default=0.15,
    show_default=True,
    help='Contrast of the laser speckle (offline).',
)
@click.option('--seed', type=int, default=0, show_default=True, help='Of the noise.')
@reconstruction_options
@click.pass_context
def demo(
    context: click.Context,
    /,
    output: Path,
    offline: bool,
    steps: int,
    motion: str,
    speckle: float,
    seed: int,
    **options: Any,
) -> None:
    """
    Scan the demo part in the simulated bench cell.

    The cell is started as it would be with hardware, one process a node, and scanned by its
    service. With --offline the pictures are rendered into a bag and rebuilt from it, without
    ROS; the options of the reconstruction are for that.
    """
    if offline:
        from ivfmc_ros.cli.demo.offline import run_offline

        run_offline(output, steps, speckle, seed, **options)
        return
    given = context.get_parameter_source
    unused = [
        name
        for name in (*options, 'speckle')
        if given(name) is click.core.ParameterSource.COMMANDLINE
    ]
    if unused:
        raise ParameterError(f'--{unused[0].replace("_", "-")}: is for --offline only')
    from ivfmc_ros.cli.demo.graph import run_graph

    run_graph(output, seed, {'part': 'demo', 'profiles': steps, 'motion': motion})
