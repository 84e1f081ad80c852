# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate all``: the whole cell from pictures of all kinds, in one adjustment."""

from pathlib import Path

import click

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.figure import draw_camera
from ivfmc_ros.calibration.figure import draw_laser
from ivfmc_ros.calibration.figure import draw_turntable
from ivfmc_ros.calibration.joint.calibrate import calibrate_jointly
from ivfmc_ros.calibration.joint.calibrate import JointCalibration
from ivfmc_ros.calibration.joint.sort_pictures import sort_pictures
from ivfmc_ros.calibration.joint.steps import run_steps
from ivfmc_ros.calibration.joint.steps import SeparateSteps
from ivfmc_ros.calibration.joint.steps import StepSettings
from ivfmc_ros.calibration.laser.depth import depth_warning
from ivfmc_ros.calibration.report import board_document
from ivfmc_ros.calibration.report import camera_report
from ivfmc_ros.calibration.report import joint_report
from ivfmc_ros.calibration.report import laser_report
from ivfmc_ros.calibration.report import scale_notes
from ivfmc_ros.calibration.report import turntable_report
from ivfmc_ros.calibration.report import write_report
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.calibration.turntable.scale import scale_warnings
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cell.laser import Stripe
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.errors import FileError
from ivfmc_ros.pictures import list_picture_tree


@click.command(name='all')
@options.pictures_argument
@options.board_option
@click.option(
    '--platter',
    'target',
    required=True,
    type=options.TARGET,
    metavar='TARGET',
    help='What lies on the platter: a board, or markers as DICT_4X4_50:30mm.',
)
@click.option(
    '--laser',
    'lasers',
    multiple=True,
    type=options.LASER_WORDS,
    metavar='NAME[=WORD,...]',
    help='A laser, and the words in the names of folders or files that say that it is on '
    '(default: its name). Once for each laser; default: laser.',
)
@click.option(
    '--board-u',
    'scale_u',
    type=options.FRACTION,
    metavar='PERCENT',
    help='Standard uncertainty of the lengths of the board, as 0.02% (a caliper with '
    'u = 0.02 mm over 100 mm). All lengths that the cell measures have it.',
)
@click.option(
    '-o',
    '--output',
    type=options.PATH,
    default=Path(),
    help='Folder for camera.yaml and cell.yaml (default: the present one).',
)
@options.model_option
@options.stripe_option
@click.option('--platter-radius', type=options.LENGTH, help='Radius within which it is bare.')
@click.option('--thickness', type=options.LENGTH, help='Of the board on the platter.')
@options.condition_options
def calibrate_all(
    folders: tuple[Path, ...],
    board: Board,
    target: Target,
    lasers: tuple[tuple[str, tuple[str, ...]], ...],
    scale_u: float | None,
    output: Path,
    model: str,
    stripe: Stripe,
    platter_radius: float | None,
    thickness: float | None,
    temperature: float | None,
    exposure: float | None,
) -> None:
    """
    Calibrate camera, lasers and turntable together from PICTURES of all kinds.

    Which board is in a picture is seen in it; which laser is on is read from the name of its
    folder or file. The separate steps give the start of one adjustment of all pictures, which
    writes the covariance of all parameters.
    """
    if not output.is_dir():
        raise FileError(f'{output}: the folder does not exist; make it first')
    # what is wiring, and no calibration
    known = options.load_or_new_draft(output / 'cell.yaml')
    pictures, place = list_picture_tree(folders), options.where(folders)
    words = dict(lasers) or {'laser': ('laser',)}
    settings = StepSettings(
        model=model, stripe=stripe, platter_radius=platter_radius, thickness=thickness or 0.0
    )
    with progress_bars() as progress:
        found = sort_pictures(board, target, pictures, words, progress)
        steps = run_steps(board, target, found.sets, settings, where=place, progress=progress)
    result = calibrate_jointly(steps, thickness=thickness or 0.0, scale_u=scale_u, where=place)
    warnings = _warnings(result, steps)
    draft = _draft(steps, result, known)
    draft = draft.with_notes(**options.condition_notes(temperature, exposure))
    written = _write(output, steps, draft, result, found.unknown, warnings)
    options.print_result(
        'Joint calibration', _rows(result, steps), warnings, written, found.unknown
    )
    for line in result.unobserved:
        options.print_line(f'not determined by the pictures: {line}')


def _warnings(result: JointCalibration, steps: SeparateSteps) -> list[str]:
    target = steps.turntable.views.target
    source = steps.turntable.scale_source if result.scale_check is None else 'laser'
    found = scale_warnings(result.scale_check, source, target)
    found += steps.camera.warnings
    for laser in result.cell.lasers:
        found += [f'{laser.name}: {text}' for text in steps.lasers[laser.name].warnings]
        found += depth_warning(laser, result.cell.turntable)
    return list(dict.fromkeys(found))


def _write(
    output: Path,
    steps: SeparateSteps,
    draft: CellDraft,
    result: JointCalibration,
    unknown: dict[str, str],
    warnings: list[str],
) -> list[Path]:
    camera_file, cell_file = output / 'camera.yaml', output / 'cell.yaml'
    camera, turntable = (
        options.output_files(camera_file),
        options.output_files(cell_file, 'turntable'),
    )
    draw_camera(camera[1], steps.camera)
    write_report(camera[2], camera_report(steps.camera))
    written = [camera_file, cell_file, *camera[1:], *turntable[1:]]
    for name, laser in steps.lasers.items():
        files = options.output_files(cell_file, name)
        draw_laser(files[1], laser)
        write_report(files[2], laser_report(laser))
        written += files[1:]
    draw_turntable(turntable[1], steps.turntable, steps.camera.camera)
    write_report(turntable[2], turntable_report(steps.turntable, []))
    joint = options.output_files(cell_file, 'joint')[2]
    write_report(joint, joint_report(result, unknown, warnings))
    save_camera(camera_file, result.cell.camera)
    save_draft(cell_file, draft)
    return [*written, joint]


def _draft(steps: SeparateSteps, result: JointCalibration, known: CellDraft) -> CellDraft:
    """Return the calibrated cell, with joint, trigger and camera frame of the one before."""
    board = steps.camera.board
    note = {
        **board_document(board, result.adjusted.state.board_shape),
        'scale': f'the squares of {board}',
        'turntable_scale': f'the squares of {board}',
        **scale_notes(result.scale_check),
    }
    return CellDraft(
        turntable=known.with_turntable(result.cell.turntable).turntable,
        camera_frame=known.camera_frame,
        lasers=result.cell.lasers,
        notes={'board': note},
        covariance=result.cell.covariance,
    )


def _rows(result: JointCalibration, steps: SeparateSteps) -> list[tuple[str, str]]:
    texts = {
        'board_px': ('corners of the board, rms', 1.0, 'px'),
        'platter_px': ('corners on the platter, rms', 1.0, 'px'),
        'board_stripe_m': ('stripe on the board to the laser plane, rms', 1e3, 'mm'),
        'platter_stripe_m': ('stripe to the platter, rms', 1e3, 'mm'),
    }
    rows = []
    for key, (name, factor, unit) in texts.items():
        if key in result.rms:
            now, before = factor * result.rms[key], factor * result.steps_rms[key]
            rows.append((name, f'{now:.3f} {unit} (separate steps: {before:.3f})'))
    stripes = sum(len(laser.used) for laser in steps.lasers.values())
    used = f'{len(result.adjusted.residuals.boards)} of the board, {stripes} with a stripe, '
    return [
        *rows,
        ('pictures', used + f'{len(result.adjusted.residuals.platter)} of the platter'),
        ('worst point of the volume, 1 sigma', options.millimeters(result.worst_point_u)),
        ('scale', f'the squares of {steps.camera.board}'),
        (
            'target on the platter, measured / nominal length',
            str(result.scale_check or 'not measured: no stripe on the bare platter'),
        ),
    ]
