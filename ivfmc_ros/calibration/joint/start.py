# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Observations and start of the joint adjustment, from the results of the separate steps."""

from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import picture_name
from ivfmc_ros.calibration.camera.board_poses import without_outliers
from ivfmc_ros.calibration.joint.observations import BoardPicture
from ivfmc_ros.calibration.joint.observations import JointObservations
from ivfmc_ros.calibration.joint.observations import PlatterCorners
from ivfmc_ros.calibration.joint.observations import PlatterStripe
from ivfmc_ros.calibration.joint.observations import StripePixels
from ivfmc_ros.calibration.joint.parameters import FreeJointParameters
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.steps import SeparateSteps
from ivfmc_ros.calibration.laser.calibrate import LaserView
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats


def observations_of(steps: SeparateSteps, thickness: float = 0.0) -> JointObservations:
    """
    Return what the separate steps used: without the pictures and corners that they rejected.

    thickness : meters, of a board on the platter
    """
    board = steps.camera.board
    striped = [
        (index, view) for index, laser in enumerate(steps.lasers.values()) for view in laser.used
    ]
    with_stripe = {view.view.path for _, view in striped}
    plain = [view for view in steps.camera.used if view.path not in with_stripe]
    return JointObservations(
        board=board,
        pictures=(
            *(BoardPicture(name=v.name, corners=v.corners, stripe=None) for v in plain),
            *(_striped(steps.camera.camera, board, index, view) for index, view in striped),
        ),
        platter=_platter(steps, thickness),
        platter_stripes=_platter_stripes(steps),
    )


def start_of(steps: SeparateSteps) -> JointState:
    """Return the state that the separate steps found."""
    views = {view.view.path: view for laser in steps.lasers.values() for view in laser.used}
    poses = [
        pose
        for view, pose in zip(steps.camera.used, steps.camera.poses, strict=True)
        if view.path not in views
    ]
    poses += [view.board_pose.pose for laser in steps.lasers.values() for view in laser.used]
    return JointState(
        camera=steps.camera.camera,
        board_shape=steps.camera.board_shape,
        lasers=tuple(laser.laser for laser in steps.lasers.values()),
        axis=steps.turntable.adjusted.axis,
        board_poses=np.array(poses),
    )


def free_of(steps: SeparateSteps, *, square: bool = True) -> FreeJointParameters:
    """Return the parameters that the joint adjustment estimates: those that the steps did."""
    distortion = steps.camera.camera.distortion
    return FreeJointParameters(
        square=square,
        fixed=tuple(4 + int(index) for index in np.flatnonzero(distortion == 0.0)),
        bend=not steps.camera.board_shape.is_flat,
        free_corners=steps.turntable.adjusted.axis.free_corners,
    )


def _striped(camera: Camera, board: Board, index: int, view: LaserView) -> BoardPicture:
    corners, shape = view.view.corners, view.board_pose.board_shape
    residuals = _pose_residuals(camera, board, shape, corners, view.board_pose.pose)
    return BoardPicture(
        name=view.view.name,
        corners=without_outliers(corners, residuals),
        stripe=StripePixels(
            laser=index, uv=view.stripe.uv[view.inlier_mask], sigma=view.stripe.sigma
        ),
    )


def _pose_residuals(
    camera: Camera, board: Board, shape: BoardShape, corners: Corners, pose: Floats
) -> Floats:
    points = shape.corners_xyz(board)[corners.ids]
    projected, _ = cv2.projectPoints(points, pose[:3], pose[3:], camera.K, camera.distortion)
    return np.asarray(corners.uv - projected.reshape(-1, 2))


def _platter(steps: SeparateSteps, thickness: float) -> PlatterCorners:
    views, kept = steps.turntable.views, steps.turntable.inlier_mask
    corners = views.observations.select(kept)
    if not isinstance(views.target, Markers):
        raised = corners.local_xyz + np.array([0.0, 0.0, thickness])
        corners = replace(corners, local_xyz=raised)
    return PlatterCorners(
        target=views.target,
        names=tuple(picture_name(path) for path in views.pictures),
        corners=corners,
        pixels=views.pixels[kept],
    )


def _platter_stripes(steps: SeparateSteps) -> tuple[PlatterStripe, ...]:
    found = []
    for index, name in enumerate(steps.lasers):
        stripes = steps.platter_stripes.get(name)
        if stripes is None:
            continue
        for number, path in enumerate(stripes.pictures):
            rows = stripes.picture == number
            if not rows.any():
                continue
            found.append(
                PlatterStripe(
                    name=picture_name(path),
                    stripe=StripePixels(
                        laser=index, uv=stripes.uv[rows], sigma=float(stripes.pixel_sigma[number])
                    ),
                )
            )
    return tuple(found)
