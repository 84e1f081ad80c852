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
@options.model_option
@click.option('--name', default='camera', show_default=True, help='Name of the camera.')
@click.option(
    '--bend/--no-bend', default=True, help='Estimate the bend of a board that is not flat.'
)
@click.option(
    '--square-pixels/--no-square-pixels',
    'square',
    default=True,
    help='Keep fx = fy; a difference is then attributed to the print of the board.',
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
    Calibrate a camera from PICTURES of a board: folders of pictures, all taken at one focus.

    Take 20 pictures or more, with the board tilted by 30 degrees or more in different directions,
    at the distances of the parts to scan, up to the corners of the image.
    """
    options.require_writable(output)
    pictures, place = options.list_all_pictures(folders), options.where(folders)
    with progress_bars() as progress:
        views = find_views(board, pictures, progress=progress)
    result = calibrate_camera(board, views, model, fit_bend=bend, square=square, where=place)
    files = options.output_files(output)
    draw_camera(files[1], result)
    write_report(files[2], camera_report(result))
    save_camera(output, replace(result.camera, name=name))
    options.print_result('Camera', _rows(result), result.warnings, files, result.dropped)


def _rows(result: CameraCalibration) -> list[tuple[str, str]]:
    K, std = result.camera.K, result.std
    return [
        ('reprojection rms', f'{result.rms:.3f} px'),
        ('views', f'{len(result.used)} used, {len(result.dropped)} not used'),
        ('worst view', f'{result.view_rms.max():.3f} px'),
        ('fx, fy', f'{K[0, 0]:.2f} ± {std["fx"]:.2f}, {K[1, 1]:.2f} ± {std["fy"]:.2f} px'),
        ('cx, cy', f'{K[0, 2]:.2f} ± {std["cx"]:.2f}, {K[1, 2]:.2f} ± {std["cy"]:.2f} px'),
        ('distortion', ', '.join(f'{value:.4f}' for value in result.camera.distortion)),
        ('coverage of the image', f'{result.coverage:.0%}'),
        ('board', options.board_text(result.board, result.board_shape)),
    ]
