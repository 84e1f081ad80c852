# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate camera``."""

from dataclasses import replace
from pathlib import Path

import click

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.figure import draw_camera
from ivfmc_ros.calibration.report import camera_report
from ivfmc_ros.calibration.report import write_report
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.progress import progress_bars


@click.command()
@options.pictures_argument
@options.board_option
@click.option(
    '-o',
    '--output',
    type=options.PATH,
    default=Path('camera.yaml'),
    show_default=True,
    help='File to write.',
)
@click.option(
    '--model',
    type=click.Choice(list(DISTORTION_COEFFICIENTS)),
    default='plumb_bob',
    show_default=True,
    help='Lens distortion: 5 coefficients, or 8 for wide-angle lenses.',
)
@click.option('--name', default='camera', show_default=True, help='Name of the camera.')
@click.option(
    '--bend/--no-bend', default=True, help='Whether the board may turn out not to be flat.'
)
@click.option(
    '--square-pixels/--no-square-pixels',
    'square',
    default=True,
    help='Whether fx = fy; if so, a difference is laid to the print of the board.',
)
def camera(
    folders: tuple[Path, ...],
    board: Board,
    output: Path,
    model: str,
    name: str,
    bend: bool,
    square: bool,
) -> None:
    """
    Calibrate a camera from PICTURES of a board: folders, all taken at one focus.

    Take 20 pictures or more with the board tilted in different directions by 30 degrees and more,
    at the distances at which parts will be, out to the corners of the image.
    """
    options.require_target(output)
    pictures, place = options.all_pictures(folders), options.where(folders)
    with progress_bars() as progress:
        views = find_views(board, pictures, progress=progress)
    made = calibrate_camera(board, views, model, bend=bend, square=square, where=place)
    files = options.files_of(output)
    draw_camera(files[1], made)
    write_report(files[2], camera_report(made))
    save_camera(output, replace(made.camera, name=name))
    options.say('Camera', _rows(made), made.warnings, files, made.dropped)


def _rows(made: CameraCalibration) -> list[tuple[str, str]]:
    K, std = made.camera.K, made.std
    return [
        ('reprojection rms', f'{made.rms:.3f} px'),
        ('views', f'{len(made.used)} used, {len(made.dropped)} not'),
        ('worst view', f'{made.view_rms.max():.3f} px'),
        ('fx, fy', f'{K[0, 0]:.2f} ± {std["fx"]:.2f}, {K[1, 1]:.2f} ± {std["fy"]:.2f} px'),
        ('cx, cy', f'{K[0, 2]:.2f} ± {std["cx"]:.2f}, {K[1, 2]:.2f} ± {std["cy"]:.2f} px'),
        ('distortion', ', '.join(f'{value:.4f}' for value in made.camera.distortion)),
        ('coverage of the image', f'{made.coverage:.0%}'),
        ('board', f'{made.board}, off flat by {options.millimetres(made.bend.sag(made.board))}'),
    ]
