# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc import-images``: makes a bag of a folder of pictures, one for each step of the table."""

from collections.abc import Sequence
import math
from pathlib import Path

import click

from ivfmc_ros.angles import load_angles
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.quantities import angle
from ivfmc_ros.cli.support.reconstruction_options import image_bits_option
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.storage.matching.frame_matching import MAX_EXPOSURES
from ivfmc_ros.storage.recording.image_import import brackets_by_number
from ivfmc_ros.storage.recording.image_import import ImageAtAngle
from ivfmc_ros.storage.recording.image_import import images_by_angles
from ivfmc_ros.storage.recording.image_import import images_by_number
from ivfmc_ros.storage.recording.image_import import import_images_as_bag

_PATH = click.Path(path_type=Path)

# so many missing steps are listed
_LISTED = 5


@click.command('import-images')
@click.argument('folder', metavar='DIR', type=_PATH)
@click.option('--camera', required=True, type=_PATH, help='camera.yaml of the camera.')
@click.option('--step', type=angle(), help='By which the table turns from one number to the next.')
@click.option('--angles', type=_PATH, help='angles.yaml that calibrate turntable measured.')
@click.option(
    '-o', '--output', type=_PATH, help='Bag folder to write (default: <name of DIR>_bag here).'
)
@click.option(
    '--direction',
    type=click.Choice(['ccw', 'cw']),
    help='Sense of --step, seen from above the table (default: ccw).',
)
@click.option('--laser', metavar='NAME', help='Laser of cell.yaml that was on, if it has several.')
@image_bits_option
@click.option(
    '--exposures',
    type=click.IntRange(1, MAX_EXPOSURES),
    default=1,
    show_default=True,
    help='Pictures of different exposure times of each step; the last number in their names '
    'tells them apart.',
)
@click.option('--rate', default=10.0, show_default=True, help='Pictures a second in the bag.')
@click.option(
    '--joint', default='turntable_joint', show_default=True, help='Name of the table in the bag.'
)
def import_images(
    folder: Path,
    camera: Path,
    step: float | None,
    angles: Path | None,
    output: Path | None,
    direction: str | None,
    laser: str | None,
    image_bits: int,
    exposures: int,
    rate: float,
    joint: str,
) -> None:
    """
    Make a bag of the pictures in DIR.

    The last number in a file name is the step of the table, and --step is the angle from one
    number to the next. Or --angles is a file with the angle of each picture. Give the number of
    --exposures to reconstruct as well.
    """
    target = output or Path(f'{folder.resolve().name}_bag')
    pictures = list_pictures(folder)
    if angles is not None:
        _refuse_both(step, direction)
        steps = images_by_angles(pictures, load_angles(angles), angles)
        gaps: list[int] = []
    elif exposures > 1:
        steps, gaps = brackets_by_number(pictures, _signed(step, direction), exposures)
    else:
        steps, gaps = images_by_number(pictures, _signed(step, direction))
    model = load_camera(camera)
    with progress_bars() as progress:
        import_images_as_bag(
            steps,
            model,
            target,
            rate=rate,
            joint=joint,
            laser=laser,
            image_bits=image_bits,
            progress=progress,
        )
    click.echo(f'{target}: {_summary(steps)}{_missing(gaps)}')


def _refuse_both(step: float | None, direction: str | None) -> None:
    if step is not None:
        raise ParameterError('--step and --angles both say how the table turned; give one')
    if direction is not None:
        raise ParameterError('--direction belongs to --step; --angles are signed')


def _signed(step: float | None, direction: str | None) -> float:
    """Return the step in radians, positive counter-clockwise."""
    if step is None:
        raise ParameterError('give --step or --angles: one of them must say how the table turned')
    if not (math.isfinite(step) and step > 0):
        raise ParameterError(
            f'--step: {math.degrees(step):g} deg must be positive; use --direction'
        )
    return -step if direction == 'cw' else step


def _summary(steps: Sequence[ImageAtAngle]) -> str:
    angles = [math.degrees(step.angle) for step in steps]
    return f'{len(steps)} pictures from {min(angles):.3f} to {max(angles):.3f} degrees'


def _missing(gaps: Sequence[int]) -> str:
    if not gaps:
        return ''
    listed = ', '.join(map(str, gaps[:_LISTED])) + (', ...' if len(gaps) > _LISTED else '')
    return f'; {len(gaps)} steps have no picture ({listed})'
