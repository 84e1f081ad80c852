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
from ivfmc_ros.calibration.report import turntable_notes
from ivfmc_ros.calibration.report import write_report
from ivfmc_ros.calibration.turntable.platter_board import platter_stripe_points
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cell.laser import Stripe
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.reconstruction_options import image_bits_option
from ivfmc_ros.errors import CellError
from ivfmc_ros.image_bits import require_known_bits
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.stripe.extract import ExtractSettings

# Pictures whose number of bits is looked at.
_INSPECTED = 4


@click.command()
@options.pictures_argument
@options.camera_option
@options.cell_option
@options.board_option
@click.option('--name', default='laser', show_default=True, help='Name of the laser in the cell.')
@options.stripe_option
@click.option(
    '--channel', default='auto', show_default=True, help='Color channels to use, as blue+red.'
)
@image_bits_option
@click.option(
    '--bend/--no-bend', default=True, help='Estimate the bend of a board that is not flat.'
)
@click.option(
    '--bow/--no-bow', default=True, help='Estimate the bow of a laser plane that is not flat.'
)
@click.option(
    '--platter',
    type=options.PATH,
    help='Folder of pictures of the bare platter with the stripe, which add the plane of the '
    'platter as a view; needs a calibrated turntable in the cell.',
)
@click.option(
    '--platter-radius',
    type=options.LENGTH,
    default='60mm',
    show_default=True,
    help='Radius within which the platter is bare.',
)
@click.option('--markers', type=options.MARKERS, help='Markers on the platter, to be masked.')
@options.condition_options
def laser(
    folders: tuple[Path, ...],
    camera_file: Path,
    cell_file: Path,
    board: Board,
    name: str,
    stripe: Stripe,
    channel: str,
    image_bits: int,
    bend: bool,
    bow: bool,
    platter: Path | None,
    platter_radius: float,
    markers: Markers | None,
    temperature: float | None,
    exposure: float | None,
) -> None:
    """
    Calibrate a laser from PICTURES of a board with the stripe on it.

    Take 20 pictures or more, with the board at all distances of the parts to scan and the stripe
    across white areas of the board. A chessboard with a wide white border is best.
    """
    options.require_writable(cell_file)
    camera, draft = load_camera(camera_file), options.load_or_new_draft(cell_file)
    extract = ExtractSettings(channel=channel, image_bits=image_bits)
    settings = LaserSettings(name=name, stripe=stripe, fit_bend=bend, fit_bow=bow, extract=extract)
    pictures, place = options.list_all_pictures(folders), options.where(folders)
    require_known_bits((read_picture(path) for path in pictures[:_INSPECTED]), image_bits)
    if platter is not None and draft.turntable is None:
        raise CellError(f"{cell_file}: turntable: missing; run 'ivfmc calibrate turntable' first")
    with progress_bars() as progress:
        views = find_views(board, pictures, camera.size, progress, with_stripe=True)
        extra = []
        if platter is not None and draft.turntable is not None:
            bare = options.list_all_pictures([platter])
            stripe_points = platter_stripe_points(
                camera, draft.turntable, platter_radius, bare, stripe, markers, progress
            )
            extra.append(stripe_points)
        result = calibrate_laser(
            camera, board, views, settings, extra=extra, where=place, progress=progress
        )
    warnings = list(result.warnings)
    if draft.turntable is not None:
        warnings += depth_warning(result.laser, draft.turntable)
    files = options.output_files(cell_file, name)
    draw_laser(files[1], result)
    write_report(files[2], {**laser_report(result), 'warnings': warnings})
    board_note = {**board_document(board, result.board_shape), 'scale': f'the squares of {board}'}
    if draft.turntable is not None:
        # its scale, and a doubt of it, hold until the table is calibrated again
        board_note |= turntable_notes(draft.notes.get('board'))
    notes = {'board': board_note, **options.condition_notes(temperature, exposure)}
    save_draft(cell_file, draft.with_laser(result.laser).with_notes(**notes))
    options.print_result(f'Laser {name}', _rows(result), warnings, files, result.dropped)


def _rows(result: LaserCalibration) -> list[tuple[str, str]]:
    laser = result.laser
    plane = ', '.join(f'{value:.6f}' for value in (*laser.normal, laser.offset))
    return [
        ('residual rms', options.millimeters(laser.residual_rms)),
        ('views', f'{len(result.used)} used, {len(result.dropped)} not used'),
        ('inlier stripe points', f'{result.inlier_fraction:.1%}'),
        ('plane nx, ny, nz, d', plane),
        ('plane, 1 sigma at its least certain point', options.millimeters(result.plane_std)),
        ('bow', f'{options.millimeters(result.bow_height)}{"" if laser.bow else ", not stored"}'),
        ('thickness of the light sheet, 1 sigma', options.millimeters(laser.thickness)),
        ('distance from the camera', _depths(result)),
        ('board', options.board_text(result.board, result.board_shape)),
        ('scale', f'the squares of {result.board}'),
    ]


def _depths(result: LaserCalibration) -> str:
    if result.laser.volume is None:
        return 'unknown'
    return f'{result.laser.volume[0, 2]:.3f} to {result.laser.volume[1, 2]:.3f} m'
