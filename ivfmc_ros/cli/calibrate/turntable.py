# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate turntable`` and ``ivfmc calibrate angles``."""

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from rich.text import Text

from ivfmc_ros.angles import save_angles
from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.figure import draw_turntable
from ivfmc_ros.calibration.laser.depth import depth_warning
from ivfmc_ros.calibration.report import scale_notes
from ivfmc_ros.calibration.report import SCALE_SOURCES
from ivfmc_ros.calibration.report import TURNTABLE_NOTES
from ivfmc_ros.calibration.report import turntable_report
from ivfmc_ros.calibration.report import write_report
from ivfmc_ros.calibration.turntable.angles import collect_angles
from ivfmc_ros.calibration.turntable.angles import fill_gaps
from ivfmc_ros.calibration.turntable.angles import PictureAngles
from ivfmc_ros.calibration.turntable.axis_adjustment import AxisAdjustment
from ivfmc_ros.calibration.turntable.calibrate import calibrate_turntable
from ivfmc_ros.calibration.turntable.calibrate import estimate_axis
from ivfmc_ros.calibration.turntable.calibrate import measure_angles
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration
from ivfmc_ros.calibration.turntable.observations import detect_targets
from ivfmc_ros.calibration.turntable.platter_stripes import find_platter_stripes
from ivfmc_ros.calibration.turntable.scale import scale_warnings
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.errors import CellError

_board_option = click.option(
    '--board', type=options.BOARD, metavar='BOARD', help='ChArUco board on the platter.'
)
_markers_option = click.option(
    '--markers',
    type=options.MARKERS,
    metavar='DICTIONARY:SIDE',
    help='Single ArUco markers anywhere on the platter, as DICT_4X4_50:30mm.',
)


@click.command()
@options.pictures_argument
@options.camera_option
@options.cell_option
@_board_option
@_markers_option
@click.option(
    '--stripe-pictures',
    type=options.PATH,
    help='Folder of pictures with the stripe on the bare platter (may be PICTURES): determines '
    'the height of the platter, and the scale from the calibration of the laser.',
)
@click.option(
    '--laser', 'laser_name', help='Laser of the stripe pictures, if the cell has several.'
)
@click.option(
    '--platter-radius',
    type=options.LENGTH,
    help='Radius of the platter within which the stripe is used (default: to the corners).',
)
@click.option(
    '--thickness', type=options.LENGTH, help='Of the board on the platter (default: none).'
)
def turntable(
    folders: tuple[Path, ...],
    camera_file: Path,
    cell_file: Path,
    board: Board | None,
    markers: Markers | None,
    stripe_pictures: Path | None,
    laser_name: str | None,
    platter_radius: float | None,
    thickness: float | None,
) -> None:
    """
    Calibrate the turntable from PICTURES of a board or markers that turn with the platter.

    Take 12 pictures or more all around the turn. A ChArUco board is best.
    """
    options.require_writable(cell_file)
    target = options.require_one_target(board, markers)
    camera, draft = load_camera(camera_file), options.load_or_new_draft(cell_file)
    laser = None if stripe_pictures is None else _laser(cell_file, draft, laser_name)
    pictures, place = options.list_all_pictures(folders), options.where(folders)
    with progress_bars() as progress:
        views = detect_targets(camera, target, pictures, progress)
        first, _ = estimate_axis(camera, views, place)
        stripes = None
        if stripe_pictures is not None and laser is not None:
            bare = options.list_all_pictures([stripe_pictures])
            radius = platter_radius or first.axis.radius(views.observations)
            stripes = find_platter_stripes(
                camera, laser, first.axis, radius, bare, target, progress=progress
            )
    result = calibrate_turntable(
        camera, views, first, stripes, thickness=thickness or 0.0, where=place
    )
    warnings = scale_warnings(result.scale_check, result.scale_source, target)
    warnings += [t for known in draft.lasers for t in depth_warning(known, result.turntable)]
    files = options.output_files(cell_file, 'turntable')
    draw_turntable(files[1], result, camera)
    write_report(files[2], turntable_report(result, warnings))
    save_draft(cell_file, _with_scale_note(draft.with_turntable(result.turntable), result))
    dropped = {p.name: f'{target} not detected' for p in views.missed}
    options.print_result('Turntable', _rows(result), warnings, files, dropped)


@click.command()
@click.argument('folder', metavar='PICTURES', type=options.PATH)
@options.camera_option
@click.option('--cell', 'cell_file', required=True, type=options.PATH, help='Calibrated cell.')
@_board_option
@_markers_option
@click.option(
    '-o',
    '--output',
    type=options.PATH,
    default=Path('angles.yaml'),
    show_default=True,
    help='File to write.',
)
@click.option(
    '--fill-gaps/--no-fill-gaps',
    'fill',
    default=False,
    help='Interpolate pictures without markers between their neighbors (default: no).',
)
def angles(
    folder: Path,
    camera_file: Path,
    cell_file: Path,
    board: Board | None,
    markers: Markers | None,
    output: Path,
    fill: bool,
) -> None:
    """Measure the table angle of each of the PICTURES of a scan by a board or markers."""
    options.require_writable(output)
    target = options.require_one_target(board, markers)
    camera, draft = load_camera(camera_file), load_draft(cell_file)
    if draft.turntable is None:
        raise CellError(f"{cell_file}: turntable: missing; run 'ivfmc calibrate turntable' first")
    pictures = options.list_all_pictures([folder])
    order = [path.name for path in pictures]
    with progress_bars() as progress:
        views = detect_targets(camera, target, pictures, progress)
    adjusted = measure_angles(camera, draft.turntable, views, str(folder))
    measured = collect_angles(views, adjusted, order)
    if fill:
        measured = fill_gaps(measured, order)
    save_angles(output, measured.by_name)
    _print_angles(measured, adjusted, output)


def _laser(cell_file: Path, draft: CellDraft, name: str | None) -> LaserPlane:
    if not draft.lasers:
        raise CellError(f"{cell_file}: lasers: none; run 'ivfmc calibrate laser' first")
    known = {laser.name: laser for laser in draft.lasers}
    if name is None and len(known) == 1:
        return draft.lasers[0]
    if name not in known:
        raise CellError(f'{cell_file}: lasers: choose one by --laser: {", ".join(known)}')
    return known[name]


def _with_scale_note(draft: CellDraft, result: TurntableCalibration) -> CellDraft:
    board = draft.notes.get('board')
    note = dict(board) if isinstance(board, dict) else {}
    note = {key: value for key, value in note.items() if key not in TURNTABLE_NOTES}
    note['turntable_scale'] = SCALE_SOURCES[result.scale_source].format(target=result.views.target)
    return draft.with_notes(board={**note, **scale_notes(result.scale_check)})


def _rows(result: TurntableCalibration) -> list[tuple[str, str]]:
    std = np.sqrt(np.diag(result.adjusted.covariance))
    steps = np.degrees(np.diff(list(result.angles.values())))
    sense = 'counter-clockwise' if result.turns_positive else 'clockwise'
    measured = str(result.scale_check or 'not measured (--stripe-pictures)')
    rows = [
        ('corners, robust sigma', f'{result.adjusted.sigma:.3f} px'),
        ('corners rms', options.millimeters(result.turntable.residual_rms)),
        ('pictures', f'{len(result.views.pictures)} used, {len(result.views.missed)} not used'),
        ('axis direction, 1 sigma', f'{np.degrees(std[:2].max()):.4f} degrees'),
        ('axis position, 1 sigma', options.millimeters(float(std[2:4].max()))),
        ('platter normal to axis', f'{np.degrees(result.wobble):.3f} degrees'),
        ('turns', f'{sense}, by {np.median(steps):.4f} degrees a picture (median)'),
        ('scale', SCALE_SOURCES[result.scale_source].format(target=result.views.target)),
        ('measured / nominal length', measured),
    ]
    if result.platter_rms is not None:
        rows.insert(2, ('stripe on the platter, rms', options.millimeters(result.platter_rms)))
    return rows


def _print_angles(measured: PictureAngles, adjusted: AxisAdjustment, output: Path) -> None:
    steps = np.degrees(measured.steps)
    stdout = console()
    lines: list[str | Text] = [
        f'{len(measured.by_name)} pictures, {len(measured.filled)} of them interpolated; '
        f'1 sigma {np.degrees(measured.std):.3f} degrees, corners {adjusted.sigma:.3f} px',
    ]
    if len(steps):
        lines.append(
            f'steps: median {np.median(steps):.4f}, least {steps.min():.4f}, '
            f'greatest {steps.max():.4f} degrees'
        )
    if measured.filled:
        lines.append(f'interpolated: {_listed(measured.filled)}')
    if measured.missing:
        lines.append(options.warning_line(f'without an angle: {_listed(measured.missing)}'))
    lines.append(f'written: {output}')
    for line in lines:
        stdout.print(line, soft_wrap=True)


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return ', '.join(names[:most]) + more
