# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a calibration found, as a document for machines (JSON); lengths in metres."""

from collections import Counter
from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.camera.bow import Bend
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserCalibration
from ivfmc_ros.calibration.turntable.calibrate import steps_of
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration

Document = dict[str, Any]


def write_report(path: Path, document: Mapping[str, Any]) -> None:
    """
    Write a report.

    :raises FileError: it cannot be written
    """
    files.write_text(path, json.dumps(document, indent=2) + '\n')


def camera_report(made: CameraCalibration) -> Document:
    """Return what is known of a camera calibration."""
    camera = made.camera
    intrinsics = [*camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), *camera.distortion.tolist()]
    return {
        'rms_px': made.rms,
        'views_used': len(made.used),
        'views_dropped': made.dropped,
        'view_rms_px': dict(
            zip((view.name for view in made.used), made.view_rms.tolist(), strict=True)
        ),
        'model': camera.model,
        'intrinsics': dict(zip(made.std, intrinsics, strict=True)),
        'std': made.std,
        'coverage': made.coverage,
        'board': board_document(made.board, made.bend),
        'scale': f'the squares of {made.board}',
        'warnings': list(made.warnings),
    }


def laser_report(made: LaserCalibration) -> Document:
    """Return what is known of a laser calibration."""
    laser = made.laser
    return {
        'name': laser.name,
        'residual_rms_m': laser.residual_rms,
        'views_used': len(made.used),
        'views_dropped': made.dropped,
        'points_kept_share': made.kept_share,
        'view_rms_m': {
            view.view.name: float(np.sqrt(np.mean(view.residuals[view.kept] ** 2)))
            for view in made.used
        },
        'plane': [*laser.normal.tolist(), laser.offset],
        'plane_std_m_at_worst_point': made.plane_error,
        'bow_m': made.bow_height,
        'bow_stored': laser.bow is not None,
        'thickness_m': laser.thickness,
        'volume_m': None if laser.volume is None else laser.volume.tolist(),
        'board': board_document(made.board, made.bend),
        'scale': f'the squares of {made.board}',
        'warnings': list(made.warnings),
    }


def turntable_report(made: TurntableCalibration, warnings: list[str]) -> Document:
    """Return what is known of a turntable calibration."""
    std = np.sqrt(np.diag(made.adjusted.covariance))
    return {
        'residual_rms_m': made.turntable.residual_rms,
        'residual_px': made.adjusted.sigma,
        'pictures_used': len(made.views.pictures),
        'pictures_without': [path.name for path in made.views.without],
        'corners_kept_share': float(made.kept.mean()),
        'axis_direction_std_rad': float(std[:2].max()),
        'axis_place_std_m': float(std[2:4].max()),
        'platter_height_std_m': float(std[4]),
        'platter_stripe_rms_m': made.platter_rms,
        'platter_stripe_points': 0 if made.stripes is None else len(made.stripes.uv),
        'wobble_rad': made.wobble,
        'wobble_std_rad': made.wobble_std,
        'turns': 'counter-clockwise' if made.turns_positive else 'clockwise',
        'angles_rad': made.angles,
        'median_step_rad': float(np.median(steps_of(list(made.angles.values())))),
        'scale': SCALES[made.scale_source].format(target=made.views.target),
        'length_over_nominal': made.scale,
        'bloom_px': made.adjusted.axis.bloom,
        'warnings': warnings,
    }


SCALES = {
    'laser': 'the laser, whose plane was calibrated with a board; not the lengths of {target}',
    'markers': 'the side of the markers {target}',
    'board': 'the squares of {target}',
}


def board_document(board: Board, bend: Bend) -> Document:
    """Return a board as it was found to be."""
    return {
        'kind': board.kind,
        'columns': board.columns,
        'rows': board.rows,
        'square_m': board.square,
        'sag_m': bend.sag(board),
        'longer_along_columns': bend.stretch,
    }


def reasons(dropped: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the names of dropped pictures by reason, the most frequent reason first."""
    counted = Counter(dropped.values())
    return {
        reason: [name for name, why in dropped.items() if why == reason]
        for reason, _ in counted.most_common()
    }
