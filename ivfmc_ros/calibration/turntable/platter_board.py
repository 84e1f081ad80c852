# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Platter of a calibrated turntable as an additional view of the laser calibration."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.calibration.laser.calibrate import triangulate_stripe
from ivfmc_ros.calibration.laser.plane import StripePoints
from ivfmc_ros.calibration.laser.stripes import BoardStripe
from ivfmc_ros.calibration.turntable.platter_stripes import extract_platter_stripes
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.stripe.extract import ExtractSettings


def platter_stripe_points(
    camera: Camera,
    turntable: Turntable,
    radius: float,
    pictures: Sequence[Path],
    stripe: Direction,
    markers: Markers | None = None,
    progress: Progress = no_progress,
) -> StripePoints:
    """
    Return the triangulated stripe on the platter, with the covariance of the turntable's pose.

    radius : meters about the axis, within which the platter is bare
    markers : on the platter, to be masked
    :raises CalibrationError: no picture shows the stripe
    """
    found = extract_platter_stripes(
        camera,
        turntable.camera_from_base,
        radius,
        pictures,
        markers,
        stripe,
        ExtractSettings(),
        progress,
    )
    R = turntable.camera_from_base[:3, :3]
    board_pose = BoardPose(
        pose=np.concatenate([cv2.Rodrigues(R)[0].ravel(), turntable.camera_from_base[:3, 3]]),
        covariance=_pose_covariance(turntable),
        board_shape=BoardShape(center=np.zeros(2), coefficients=np.zeros(4)),
        rms=0.0,
    )
    # all pictures show the same line in space: one view
    sigma = float(np.median([s for *_, s in found]))
    uv = np.concatenate([uv for _, uv, _ in found])
    stripe_points = BoardStripe(uv=uv, sigma=sigma, width=np.full(len(uv), np.nan))
    return triangulate_stripe(camera, board_pose, stripe_points, stripe)


def _pose_covariance(turntable: Turntable) -> Floats:
    """Return the (6, 6) covariance of (rotation vector, translation) of the turntable."""
    if turntable.covariance is None:
        return np.diag([1e-3] * 3 + [max(turntable.residual_rms, 1e-5)] * 3) ** 2
    rotation, _ = cv2.Rodrigues(turntable.camera_from_base[:3, :3])
    turns = [
        cv2.Rodrigues(cv2.Rodrigues(1e-6 * unit)[0] @ cv2.Rodrigues(rotation)[0])[0].ravel()
        for unit in np.eye(3)
    ]
    change = np.zeros((6, 6))
    change[:3, 3:] = (np.array(turns) - rotation.ravel()).T / 1e-6
    change[3:, :3] = np.eye(3)
    return np.asarray(change @ turntable.covariance @ change.T)
