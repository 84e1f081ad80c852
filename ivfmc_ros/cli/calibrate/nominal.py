# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate nominal``."""

import math
from pathlib import Path

import click
from rich.console import Console

from ivfmc_ros.calibration.nominal import axial_cell
from ivfmc_ros.calibration.nominal import AxialLaser
from ivfmc_ros.calibration.nominal import paper_cell
from ivfmc_ros.calibration.nominal import PaperGeometry
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError


@click.command()
@options.camera_option
@click.option(
    '-o',
    '--output',
    type=options.PATH,
    default=Path('cell.yaml'),
    show_default=True,
    help='File to write; must not exist yet.',
)
@click.option(
    '--distance',
    required=True,
    type=options.LENGTH,
    help="From the axis to the camera: with --above horizontally (the paper's D), else straight.",
)
@click.option('--elevation', type=float, help='Degrees of the camera above the platter.')
@click.option('--aim', type=options.LENGTH, help='Height on the axis that the camera looks at.')
@click.option(
    '--laser',
    'lasers',
    multiple=True,
    metavar='NAME:DEGREES',
    help='Laser whose plane contains the axis, and its azimuth in degrees from the camera about '
    'the axis, counter-clockwise from above. Can be repeated.',
)
@click.option('--above', type=options.LENGTH, help="The paper's H: camera above the laser.")
@click.option('--tilt', type=float, help="The paper's angle: degrees the camera looks down.")
@click.option('--laser-height', type=options.LENGTH, help='Of the laser above the platter.')
@click.option(
    '--hits',
    type=options.LENGTH,
    help='Height at which the laser plane meets the axis (default: horizontal).',
)
def nominal(
    camera_file: Path,
    output: Path,
    distance: float,
    elevation: float | None,
    aim: float | None,
    lasers: tuple[str, ...],
    above: float | None,
    tilt: float | None,
    laser_height: float | None,
    hits: float | None,
) -> None:
    """
    Write a nominal cell.yaml from measured lengths; lengths with their unit, as 400mm.

    Either a camera and lasers whose planes contain the axis (--elevation, --aim, --laser), or the
    paper's arrangement: the camera above a laser whose stripe lies along the rows of the picture
    (--above, --tilt, --laser-height, --hits).
    """
    options.require_writable(output)
    if output.exists():
        raise FileError(f'{output}: the file exists; name another file or move it away')
    camera = load_camera(camera_file)
    cell: Cell
    if above is not None:
        if tilt is None or lasers:
            raise click.UsageError('--above needs --tilt, and goes without --laser.')
        geometry = PaperGeometry(
            distance=distance,
            height=above,
            tilt=math.radians(tilt),
            laser_height=laser_height or 0.0,
            axis_height=hits,
        )
        cell = paper_cell(camera, geometry)
    else:
        if elevation is None or not lasers:
            raise click.UsageError('Give --elevation and --laser, or --above and --tilt.')
        parsed = [_laser(text) for text in lasers]
        cell = axial_cell(camera, distance, math.radians(elevation), aim or 0.0, parsed)
    save_cell(output, cell)
    text = f'written: {output}; nominal, only as accurate as the measured lengths'
    Console(markup=False).print(text, soft_wrap=True, highlight=False)


def _laser(text: str) -> AxialLaser:
    name, colon, degrees = text.rpartition(':')
    try:
        azimuth = float(degrees)
    except ValueError:
        azimuth = math.nan
    if not (colon and name and math.isfinite(azimuth)):
        raise ParameterError(f"laser: {text!r} is not understood; write e.g. 'left:36'")
    return AxialLaser(name=name, azimuth=math.radians(azimuth))
