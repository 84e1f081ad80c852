# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a calibration board in pictures of a calibrated camera, with covariances."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.views import MIN_CORNERS
from ivfmc_ros.calibration.camera.bundle import BundleState
from ivfmc_ros.calibration.camera.bundle import FreeParameters
from ivfmc_ros.calibration.camera.bundle import pose_covariances
from ivfmc_ros.calibration.camera.calibrate import adjust_with_shape
from ivfmc_ros.calibration.camera.calibrate import inlier_views
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# A corner is an outlier if its residual exceeds this multiple of the median of its picture
_OUTLIER_FACTOR = 2.5
# and this many pixels, the noise of a corner of a tilted board.
_MIN_OUTLIER_PX = 0.08


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardPose:
    """
    Pose of a board in ``camera_optical_frame``.

    pose : (6,) rotation vector and translation in meters, board to camera
    covariance : (6, 6) of ``pose``
    rms : pixel, of the residuals of its corners
    """

    pose: Floats
    covariance: Floats
    board_shape: BoardShape
    rms: float

    def intersect(self, rays: Floats, pose: Floats | None = None) -> Floats:
        """
        Return the intersections of camera rays with the board.

        rays : (n, 3) directions in ``camera_optical_frame``
        pose : (6,) to use instead of ``self.pose``
        returns : (n, 3) meters, ``camera_optical_frame``
        """
        pose = self.pose if pose is None else pose
        R, _ = cv2.Rodrigues(pose[:3])
        points = self.board_shape.intersect(-R.T @ pose[3:], rays @ R)
        return np.asarray(points @ R.T + pose[3:])

    def to_board(self, points_xyz: Floats) -> Floats:
        """Transform (n, 3) points in meters from the camera frame to the board frame."""
        R, _ = cv2.Rodrigues(self.pose[:3])
        return np.asarray((points_xyz - self.pose[3:]) @ R)

    def to_camera(self, points_xyz: Floats) -> Floats:
        """Transform (n, 3) points in meters from the board frame to the camera frame."""
        R, _ = cv2.Rodrigues(self.pose[:3])
        return np.asarray(points_xyz @ R.T + self.pose[3:])


def estimate_board_poses(
    board: Board, views: Sequence[Corners], camera: Camera, fit_bend: bool = True
) -> tuple[list[BoardPose], Bools]:
    """
    Estimate the pose of the board in every view, and its shape from all views together.

    fit_bend : whether the board may have a shape other than the nominal one
    returns : the poses, and (views,) bool: views that are no outliers
    """
    start = BundleState(
        intrinsics=np.array([*camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], *camera.distortion]),
        board_shape=BoardShape.flat(board),
        poses=np.array([initial_board_pose(board, view, camera) for view in views]),
        covariance=np.zeros((0, 0)),
        residuals=(),
    )
    free = FreeParameters(intrinsics=False, fit_stretch=fit_bend, fit_bend=fit_bend)
    bundle = adjust_with_shape(board, views, start, free)
    views = [without_outliers(view, r) for view, r in zip(views, bundle.residuals, strict=True)]
    bundle = adjust_with_shape(board, views, replace(bundle, residuals=()), free)
    covariances = pose_covariances(board, views, bundle)
    board_poses = [
        BoardPose(pose=pose, covariance=covariance, board_shape=bundle.board_shape, rms=float(rms))
        for pose, covariance, rms in zip(bundle.poses, covariances, bundle.view_rms, strict=True)
    ]
    return board_poses, inlier_views(bundle.view_rms)


def without_outliers(view: Corners, residuals: Floats) -> Corners:
    """
    Return the corners without those of large residuals: the stripe displaces those it crosses.

    residuals : (n, 2) pixels
    """
    off = np.linalg.norm(residuals, axis=1)
    keep = off <= max(_OUTLIER_FACTOR * float(np.median(off)), _MIN_OUTLIER_PX)
    return view.select(keep) if keep.sum() >= MIN_CORNERS else view


def initial_board_pose(board: Board, view: Corners, camera: Camera) -> Floats:
    """Return the (6,) pose of a flat board in one picture (Collins & Bartoli 2014, IPPE)."""
    # IPPE returns both poses of the planar ambiguity; take the one that fits better
    _, turns, shifts, errors = cv2.solvePnPGeneric(
        board.corners_xyz[view.ids],
        view.uv.reshape(-1, 1, 2),
        camera.K,
        camera.distortion,
        flags=cv2.SOLVEPNP_IPPE,
    )
    best = int(np.argmin(np.ravel(errors)))
    return np.concatenate([np.ravel(turns[best]), np.ravel(shifts[best])])
