# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the board was in each picture, seen by a calibrated camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.views import MIN_CORNERS
from ivfmc_ros.calibration.camera.bow import Bend
from ivfmc_ros.calibration.camera.bundle import Bundle
from ivfmc_ros.calibration.camera.bundle import Free
from ivfmc_ros.calibration.camera.bundle import pose_covariances
from ivfmc_ros.calibration.camera.calibrate import adjust_with_bend
from ivfmc_ros.calibration.camera.calibrate import good_views
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# A corner is left out if it is this many medians off, and this many pixels.
_DISTURBED = 2.5
_GOOD_ENOUGH = 0.08


@dataclass(frozen=True, eq=False, kw_only=True)
class Placed:
    """
    A board in the camera's frame.

    pose : (6,) rotation vector and translation in metres, board to camera
    covariance : (6, 6) of it
    rms : pixel, of its corners
    """

    pose: Floats
    covariance: Floats
    bend: Bend
    rms: float

    def intersect(self, rays: Floats, pose: Floats | None = None) -> Floats:
        """
        Return where rays from the camera meet the board.

        rays : (n, 3) directions in ``camera_optical_frame``
        pose : (6,) to use instead of the board's own
        returns : (n, 3) metres, ``camera_optical_frame``
        """
        pose = self.pose if pose is None else pose
        R, _ = cv2.Rodrigues(pose[:3])
        points = self.bend.intersect(-R.T @ pose[3:], rays @ R)
        return np.asarray(points @ R.T + pose[3:])

    def to_board(self, points_xyz: Floats) -> Floats:
        """Take (n, 3) points from the camera to the board."""
        R, _ = cv2.Rodrigues(self.pose[:3])
        return np.asarray((points_xyz - self.pose[3:]) @ R)

    def to_camera(self, points_xyz: Floats) -> Floats:
        """Take (n, 3) points from the board to the camera."""
        R, _ = cv2.Rodrigues(self.pose[:3])
        return np.asarray(points_xyz @ R.T + self.pose[3:])


def place_boards(
    board: Board, views: Sequence[Corners], camera: Camera, bend: bool = True
) -> tuple[list[Placed], Bools]:
    """
    Find the pose of the board in every view, and its bend from all of them together.

    bend : whether the board may have a shape other than the nominal one
    returns : the boards, and (views,) bool: which views fit as well as the others
    """
    start = Bundle(
        intrinsics=np.array([*camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], *camera.distortion]),
        bend=Bend.flat(board),
        poses=np.array([_first_pose(board, view, camera) for view in views]),
        covariance=np.zeros((0, 0)),
        residuals=(),
    )
    free = Free(intrinsics=False, stretch=bend, bend=bend)
    bundle = adjust_with_bend(board, views, start, free)
    views = [_undisturbed(view, r) for view, r in zip(views, bundle.residuals, strict=True)]
    bundle = adjust_with_bend(board, views, replace(bundle, residuals=()), free)
    covariances = pose_covariances(board, views, bundle)
    placed = [
        Placed(pose=pose, covariance=covariance, bend=bundle.bend, rms=float(rms))
        for pose, covariance, rms in zip(bundle.poses, covariances, bundle.view_rms, strict=True)
    ]
    return placed, good_views(bundle.view_rms)


def _undisturbed(view: Corners, residuals: Floats) -> Corners:
    """Leave out corners that are off: the stripe moves those that it crosses."""
    off = np.linalg.norm(residuals, axis=1)
    keep = off <= max(_DISTURBED * float(np.median(off)), _GOOD_ENOUGH)
    return view.chosen(keep) if keep.sum() >= MIN_CORNERS else view


def _first_pose(board: Board, view: Corners, camera: Camera) -> Floats:
    # of the two poses that a flat board has at a distance, the one that fits better
    _, turns, shifts, errors = cv2.solvePnPGeneric(
        board.corners_xyz[view.ids],
        view.uv.reshape(-1, 1, 2),
        camera.K,
        camera.distortion,
        flags=cv2.SOLVEPNP_IPPE,
    )
    best = int(np.argmin(np.ravel(errors)))
    return np.concatenate([np.ravel(turns[best]), np.ravel(shifts[best])])
