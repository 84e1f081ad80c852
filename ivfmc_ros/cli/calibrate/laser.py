# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate laser``."""

from pathlib import Path

import click

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.calibration.figure import draw_laser
from ivfmc_ros.calibration.laser.calibrate import calibrate_laser
from ivfmc_ros.calibration.laser.calibrate import LaserCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserSettings
from ivfmc_ros.calibration.laser.depth import depth_warning
from ivfmc_ros.calibration.report import board_document
from ivfmc_ros.calibration.report import laser_report
from ivfmc_ros.calibration.report import write_report
from ivfmc_ros.calibration.turntable.platter_view import platter_view
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cell.laser import Stripe
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.errors import CellError
from ivfmc_ros.stripe.extract import ExtractSettings


@click.command()
@options.pictures_argument
@options.camera_option
@options.cell_option
@options.board_option
@click.option('--name', default='laser', show_default=True, help='Name of the laser in the cell.')
@click.option(
    '--stripe',
    type=click.Choice(['rows', 'columns']),
    default='rows',
    show_default=True,
    help='One stripe point in every row (an upright stripe), or in every column.',
)
@click.option(
    '--channel', default='auto', show_default=True, help='Colours that measure, as blue+red.'
)
@click.option('--bend/--no-bend', default=True, help='Whether the board may not be flat.')
@click.option('--bow/--no-bow', default=True, help='Whether the sheet may not be plane.')
@click.option(
    '--platter',
    type=options.PATH,
    help='Folder of pictures of the bare platter with the stripe, to refine the sheet where the '
    'table stands; needs a calibrated turntable in the cell.',
)
@click.option(
    '--platter-radius',
    type=options.LENGTH,
    default='60mm',
    show_default=True,
    help='Radius within which the platter is bare.',
)
@click.option('--markers', type=options.MARKERS, help='Markers on the platter, to leave out.')
def laser(
    folders: tuple[Path, ...],
    camera_file: Path,
    cell_file: Path,
    board: Board,
    name: str,
    stripe: Stripe,
    channel: str,
    bend: bool,
    bow: bool,
    platter: Path | None,
    platter_radius: float,
    markers: Markers | None,
) -> None:
    """
    Calibrate a laser from PICTURES of a board with the stripe on it.

    Take 20 pictures or more, with the board at all distances at which parts will be, and the
    stripe across white parts of the board. A chessboard with a wide white border is best.
    """
    options.require_target(cell_file)
    camera, draft = load_camera(camera_file), options.draft_of(cell_file)
    extract = ExtractSettings(channel=channel)
    settings = LaserSettings(name=name, stripe=stripe, bend=bend, bow=bow, extract=extract)
    pictures, place = options.all_pictures(folders), options.where(folders)
    if platter is not None and draft.turntable is None:
        raise CellError(f"{cell_file}: turntable: is missing; run 'ivfmc calibrate turntable'")
    with progress_bars() as progress:
        views = find_views(board, pictures, camera.size, progress, lit=True)
        extra = []
        if platter is not None and draft.turntable is not None:
            bare = options.all_pictures([platter])
            seen = platter_view(
                camera, draft.turntable, platter_radius, bare, stripe, markers, progress
            )
            extra.append(seen)
        made = calibrate_laser(
            camera, board, views, settings, extra=extra, where=place, progress=progress
        )
    warnings = list(made.warnings)
    if draft.turntable is not None:
        warnings += depth_warning(made.laser, draft.turntable)
    files = options.files_of(cell_file, name)
    draw_laser(files[1], made)
    write_report(files[2], {**laser_report(made), 'warnings': warnings})
    noted = {**board_document(board, made.bend), 'scale': f'the squares of {board}'}
    save_draft(cell_file, draft.with_laser(made.laser).with_notes(board=noted))
    options.say(f'Laser {name}', _rows(made), warnings, files, made.dropped)


def _rows(made: LaserCalibration) -> list[tuple[str, str]]:
    laser = made.laser
    plane = ', '.join(f'{value:.6f}' for value in (*laser.normal, laser.offset))
    return [
        ('residual rms', options.millimetres(laser.residual_rms)),
        ('views', f'{len(made.used)} used, {len(made.dropped)} not'),
        ('stripe points kept', f'{made.kept_share:.1%}'),
        ('plane nx, ny, nz, d', plane),
        ('plane, 1 sigma at its worst point', options.millimetres(made.plane_error)),
        ('bow', f'{options.millimetres(made.bow_height)}{"" if laser.bow else ", not stored"}'),
        ('thickness of the sheet, 1 sigma', options.millimetres(laser.thickness)),
        ('distance from the camera', _depths(made)),
        ('board', f'{made.board}, off flat by {options.millimetres(made.bend.sag(made.board))}'),
        ('scale', f'the squares of {made.board}'),
    ]


def _depths(made: LaserCalibration) -> str:
    if made.laser.volume is None:
        return 'unknown'
    return f'{made.laser.volume[0, 2]:.3f} to {made.laser.volume[1, 2]:.3f} m'
