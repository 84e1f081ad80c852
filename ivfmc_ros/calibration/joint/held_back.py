# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Residuals of pictures that a calibration has not used.

Only what belongs to the picture itself is estimated: the pose of its board, or its table angle.
The stripe takes no part in that, so that its residual is a prediction.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.camera.board_poses import initial_board_pose
from ivfmc_ros.calibration.joint.observations import JointObservations
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.joint.residuals import board_corner_residuals
from ivfmc_ros.calibration.joint.residuals import board_stripe_residuals
from ivfmc_ros.calibration.joint.residuals import platter_corner_residuals
from ivfmc_ros.calibration.joint.residuals import platter_stripe_residuals
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats

_ITERATIONS = 15
# Start angles that are tried for a picture of the platter: every degree.
_START_ANGLES = 360
# Residuals beyond so many robust standard deviations are left out of an rms: a corner that a
# stripe crosses, a stripe point on dirt.
_OUTLIER = 5.0
_MAD_TO_SIGMA = 1.4826  # median absolute deviation to sigma of a normal distribution


@dataclass(frozen=True, kw_only=True)
class HeldBackResiduals:
    """
    Root mean squares without outliers; NaN where nothing of a kind is held back.

    board, platter : pixels, of corners (both coordinates)
    board_stripe, platter_stripe : meters, of stripes from plane and platter
    pictures : number of pictures
    """

    board: float
    board_stripe: float
    platter: float
    platter_stripe: float
    pictures: int


def held_back_residuals(state: JointState, seen: JointObservations) -> HeldBackResiduals:
    """
    Return the residuals of pictures with a state that was estimated without them.

    state : its poses and angles are not used
    """
    fitted = with_own_parameters(state, seen)
    order = ParameterOrder.of(fitted)
    boards, stripes = [], []
    for picture, pose in zip(seen.pictures, fitted.board_poses, strict=True):
        found = board_corner_residuals(fitted, order, seen.board, picture, pose)
        boards.append(np.linalg.norm(found.values.reshape(-1, 2), axis=1))
        if picture.stripe is not None:
            stripes.append(board_stripe_residuals(fitted, order, picture.stripe, pose).values)
    platter = []
    if seen.platter.names:
        values = platter_corner_residuals(fitted, order, seen.platter).values
        platter.append(np.linalg.norm(values.reshape(-1, 2), axis=1))
    heights = [
        platter_stripe_residuals(fitted, order, one.stripe).values for one in seen.platter_stripes
    ]
    return HeldBackResiduals(
        board=_rms(boards),
        board_stripe=_rms(stripes),
        platter=_rms(platter),
        platter_stripe=_rms(heights),
        pictures=len(seen.names()),
    )


def with_own_parameters(state: JointState, seen: JointObservations) -> JointState:
    """Return the state with the board poses and table angles of other pictures."""
    poses = [_board_pose(state, seen, number) for number in range(len(seen.pictures))]
    return replace(
        state,
        board_poses=np.array(poses).reshape(-1, 6),
        axis=_axis_with_angles(state.camera, state.axis, seen),
    )


def _board_pose(state: JointState, seen: JointObservations, number: int) -> Floats:
    picture, order = seen.pictures[number], ParameterOrder.of(state)
    pose = initial_board_pose(seen.board, picture.corners, state.camera)
    for _ in range(_ITERATIONS):
        found = board_corner_residuals(state, order, seen.board, picture, pose)
        off = np.linalg.norm(found.values.reshape(-1, 2), axis=1)
        weights = np.repeat(1.0 / np.maximum(off, 2.0 * np.median(off) + 1e-9), 2)
        J = found.local * weights[:, None]
        step = np.linalg.lstsq(J.T @ found.local, J.T @ found.values, rcond=None)[0]
        pose = pose + step
        if np.abs(step).max() < 1e-10:
            break
    return np.asarray(pose)


def _axis_with_angles(camera: Camera, axis: AxisState, seen: JointObservations) -> AxisState:
    """Return the axis with the table angle of each picture: every degree, then Gauss-Newton."""
    corners, count = seen.platter.corners, len(seen.platter.names)
    if not count:
        return replace(axis, angles=np.empty(0))
    # one pixel more of bloom is the same at all angles, so that it does not matter for the start
    best, least = np.zeros(count), np.full(count, np.inf)
    for angle in 2 * np.pi * np.arange(_START_ANGLES) / _START_ANGLES:
        turned = replace(axis, angles=np.full(count, angle))
        projected = camera.project(turned.corners_in_camera(corners))
        off = np.linalg.norm(seen.platter.pixels - projected, axis=1)
        mean = np.bincount(corners.picture, off, count) / np.bincount(
            corners.picture, minlength=count
        )
        better = mean < least
        best[better], least[better] = angle, mean[better]
    axis = replace(axis, angles=best)
    for _ in range(_ITERATIONS):
        axis = replace(axis, angles=axis.angles + _angle_step(camera, axis, seen))
    return axis


def _angle_step(camera: Camera, axis: AxisState, seen: JointObservations) -> Floats:
    step, corners = 1e-6, seen.platter.corners
    here = camera.project(axis.corners_in_camera(corners))
    ahead = camera.project(replace(axis, angles=axis.angles + step).corners_in_camera(corners))
    J = (ahead - here) / step
    off = seen.platter.pixels - here - axis.bloom * corners.bloom_jacobian
    size = np.linalg.norm(off, axis=1)
    weights = 1.0 / np.maximum(size, 2.0 * np.median(size) + 1e-9)
    count = len(axis.angles)
    top = np.bincount(corners.picture, weights * (J * off).sum(axis=1), count)
    bottom = np.bincount(corners.picture, weights * (J * J).sum(axis=1), count)
    return np.asarray(top / np.maximum(bottom, 1e-30))


def _rms(parts: list[Floats]) -> float:
    if not parts:
        return float('nan')
    values = np.concatenate(parts)
    limit = _OUTLIER * _MAD_TO_SIGMA * float(np.median(np.abs(values)))
    kept = values[np.abs(values) <= limit]
    return float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0
