# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate nominal``."""

from pathlib import Path

import click

from ivfmc_ros.calibration.nominal import axial_cell
from ivfmc_ros.calibration.nominal import AxialLaser
from ivfmc_ros.calibration.nominal import paper_cell
from ivfmc_ros.calibration.nominal import PaperGeometry
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.quantities import parse_angle
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
@click.option(
    '--elevation', type=options.ANGLE, help='Of the camera above the platter, seen from the axis.'
)
@click.option('--aim', type=options.LENGTH, help='Height on the axis that the camera looks at.')
@click.option(
    '--laser',
    'lasers',
    multiple=True,
    metavar='NAME:ANGLE',
    help='Laser whose plane contains the axis, and its azimuth from the camera about '
    'the axis, counter-clockwise from above. Can be repeated.',
)
@click.option('--above', type=options.LENGTH, help="The paper's H: camera above the laser.")
@click.option('--tilt', type=options.ANGLE, help="The paper's angle: the camera looks down by it.")
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
    Write a nominal cell.yaml from measured lengths and angles.

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
            tilt=tilt,
            laser_height=laser_height or 0.0,
            axis_height=hits,
        )
        cell = paper_cell(camera, geometry)
    else:
        if elevation is None or not lasers:
            raise click.UsageError('Give --elevation and --laser, or --above and --tilt.')
        parsed = [_laser(text) for text in lasers]
        cell = axial_cell(camera, distance, elevation, aim or 0.0, parsed)
    save_cell(output, cell)
    text = f'written: {output}; nominal, only as accurate as the measured lengths'
    console().print(text, soft_wrap=True)


def _laser(text: str) -> AxialLaser:
    name, colon, azimuth = text.rpartition(':')
    if not (colon and name):
        raise ParameterError(f"--laser: {text!r} is not NAME:ANGLE; write for example 'left:36'")
    try:
        return AxialLaser(name=name, azimuth=parse_angle(azimuth))
    except click.BadParameter as error:
        raise ParameterError(f'--laser {text!r}: {error.message}') from error
