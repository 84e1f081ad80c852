# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""JSON reports of calibration results; lengths in meters, angles in radians."""

from collections import Counter
from collections.abc import Mapping
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.joint.calibrate import JointCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserCalibration
from ivfmc_ros.calibration.turntable.calibrate import angle_steps
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration
from ivfmc_ros.calibration.turntable.scale import ScaleCheck
from ivfmc_ros.cell.scale import DOUBT

Document = dict[str, Any]


def write_report(path: Path, document: Mapping[str, Any]) -> None:
    """
    Write a report as JSON.

    :raises FileError: the file cannot be written
    """
    files.write_text(path, json.dumps(document, indent=2) + '\n')


def camera_report(result: CameraCalibration) -> Document:
    """Return the report of a camera calibration."""
    camera = result.camera
    intrinsics = [*camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), *camera.distortion.tolist()]
    return {
        'rms_px': result.rms,
        'views_used': len(result.used),
        'views_dropped': result.dropped,
        'view_rms_px': dict(
            zip((view.name for view in result.used), result.view_rms.tolist(), strict=True)
        ),
        'model': camera.model,
        'intrinsics': dict(zip(result.std, intrinsics, strict=True)),
        'std': result.std,
        'coverage': result.coverage,
        'board': board_document(result.board, result.board_shape),
        'scale': f'the squares of {result.board}',
        'warnings': list(result.warnings),
    }


def laser_report(result: LaserCalibration) -> Document:
    """Return the report of a laser calibration."""
    laser = result.laser
    return {
        'name': laser.name,
        'residual_rms_m': laser.residual_rms,
        'views_used': len(result.used),
        'views_dropped': result.dropped,
        'points_kept_share': result.inlier_fraction,
        'view_rms_m': {
            view.view.name: float(np.sqrt(np.mean(view.residuals[view.inlier_mask] ** 2)))
            for view in result.used
        },
        'plane': [*laser.normal.tolist(), laser.offset],
        'plane_std_m_at_worst_point': result.plane_std,
        'bow_m': result.bow_height,
        'bow_stored': laser.bow is not None,
        'thickness_m': laser.thickness,
        'volume_m': None if laser.volume is None else laser.volume.tolist(),
        'board': board_document(result.board, result.board_shape),
        'scale': f'the squares of {result.board}',
        'warnings': list(result.warnings),
    }


def turntable_report(result: TurntableCalibration, warnings: list[str]) -> Document:
    """Return the report of a turntable calibration; ``warnings`` come from the caller."""
    std = np.sqrt(np.diag(result.adjusted.covariance))
    return {
        'residual_rms_m': result.turntable.residual_rms,
        'residual_px': result.adjusted.sigma,
        'pictures_used': len(result.views.pictures),
        'pictures_without': [path.name for path in result.views.missed],
        'corners_kept_share': float(result.inlier_mask.mean()),
        'axis_direction_std_rad': float(std[:2].max()),
        'axis_place_std_m': float(std[2:4].max()),
        'platter_height_std_m': float(std[4]),
        'platter_stripe_rms_m': result.platter_rms,
        'platter_stripe_points': 0 if result.stripes is None else len(result.stripes.uv),
        'wobble_rad': result.wobble,
        'wobble_std_rad': result.wobble_std,
        'turns': 'counter-clockwise' if result.turns_positive else 'clockwise',
        'angles_rad': result.angles,
        'median_step_rad': float(np.median(angle_steps(list(result.angles.values())))),
        'scale': SCALE_SOURCES[result.scale_source].format(target=result.views.target),
        'length_over_nominal': result.scale,
        'length_over_nominal_u': _check_u(result.scale_check),
        'bloom_px': result.adjusted.axis.bloom,
        'warnings': warnings,
    }


def joint_report(
    result: JointCalibration, unknown: Mapping[str, str], warnings: Sequence[str] = ()
) -> Document:
    """
    Return the report of a joint calibration.

    unknown : pictures that show nothing, with the reason
    warnings : of the steps and of the joint adjustment
    """
    covariance = result.cell.covariance
    noise = result.adjusted.noise
    camera, check = result.cell.camera, result.scale_check
    return {
        'rms': result.rms,
        'rms_of_separate_steps': result.steps_rms,
        'noise': {
            'board_px': noise.board,
            'platter_px': noise.platter,
            'board_stripe_common_m': noise.board_stripe,
            'platter_stripe_common_m': noise.platter_stripe,
        },
        'pictures': {
            'board': len(result.adjusted.residuals.boards),
            'board_with_stripe': len(result.adjusted.residuals.board_stripes),
            'platter': len(result.adjusted.residuals.platter),
            'platter_with_stripe': len(result.adjusted.residuals.platter_stripes),
        },
        'pictures_not_used': dict(unknown),
        'intrinsics': [
            *camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
            *camera.distortion.tolist(),
        ],
        'worst_point_u_m': result.worst_point_u,
        'scale_u': None if covariance is None else covariance.scale_u,
        'length_over_nominal': None if check is None else check.ratio,
        'length_over_nominal_u': _check_u(check),
        'std': {}
        if covariance is None
        else dict(
            zip(
                covariance.parameters,
                np.sqrt(np.diag(covariance.matrix)).tolist(),
                strict=True,
            )
        ),
        'not_determined_by_the_pictures': list(result.unobserved),
        'warnings': list(warnings),
    }


# Keys of the note ``board`` of a cell that the calibration of the turntable writes.
TURNTABLE_NOTES = ('turntable_scale', 'length_over_nominal', 'length_over_nominal_u', DOUBT)


def turntable_notes(board: Any) -> Document:
    """Return the part of a note ``board`` that the calibration of the turntable wrote."""
    if not isinstance(board, Mapping):
        return {}
    return {key: board[key] for key in TURNTABLE_NOTES if key in board}


def scale_notes(check: ScaleCheck | None) -> Document:
    """Return what the note ``board`` of a cell keeps of a check of its scale."""
    if check is None:
        return {}
    notes = {
        'length_over_nominal': round(check.ratio, 6),
        'length_over_nominal_u': round(check.u, 6),
    }
    if check.is_doubtful:
        notes[DOUBT] = round(check.difference, 6)
    return notes


def _check_u(check: ScaleCheck | None) -> float | None:
    return None if check is None else check.u


# What the unit of length of the cell was taken from, by ``TurntableCalibration.scale_source``.
SCALE_SOURCES = {
    'laser': 'the laser, whose plane was calibrated with a board; not the lengths of {target}',
    'markers': 'the side of the markers {target}',
    'board': 'the squares of {target}',
}


def board_document(board: Board, shape: BoardShape) -> Document:
    """Return the nominal board and its measured deviation from the nominal shape."""
    return {
        'kind': board.kind,
        'columns': board.columns,
        'rows': board.rows,
        'square_m': board.square,
        'sag_m': shape.sag(board),
        'longer_along_columns': shape.stretch,
    }


def pictures_by_reason(dropped: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the names of dropped pictures by reason, the most frequent reason first."""
    counted = Counter(dropped.values())
    return {
        reason: [name for name, why in dropped.items() if why == reason]
        for reason, _ in counted.most_common()
    }
