# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Residuals of the pictures and their derivatives by the parameters of the joint adjustment.

A residual is observed minus predicted: pixels for corners, meters for stripes (the distance of
the triangulated point from the laser plane, or its height above the platter).
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.calibration.joint.observations import BoardPicture
from ivfmc_ros.calibration.joint.observations import PlatterCorners
from ivfmc_ros.calibration.joint.observations import StripePixels
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import moved_laser
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.laser.plane import bow_basis
from ivfmc_ros.calibration.laser.plane import error_shapes
from ivfmc_ros.calibration.turntable.axis_adjustment import apply_axis_step
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.covariance import intrinsics_jacobian
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats

_STEP = 1e-6  # radians, meters, of the numerical derivatives
_PIXEL_STEP = 0.05  # pixels, of the numerical derivatives
_SHAPE_STEP = 1e-4  # 1/meter: 1e-5 meters at 0.3 m from the center


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureResiduals:
    """
    Residuals of one kind in one picture.

    values : (m,)
    common : (m, count) derivative of the prediction by the common parameters
    local : (m, l) derivative by the pose of the board (6) or the table angle (1), or (m, 0)
    pixel_sigma : (m,) standard deviation of a stripe residual by its pixel; ones for corners
    shapes : (m, s) errors common to a stripe, of unit size; (m, 0) for corners
    """

    values: Floats
    common: Floats
    local: Floats
    pixel_sigma: Floats
    shapes: Floats


def board_corner_residuals(
    state: JointState, order: ParameterOrder, board: Board, picture: BoardPicture, pose: Floats
) -> PictureResiduals:
    """Return the (2n,) residuals of the corners of a board, pixels."""
    ids, camera = picture.corners.ids, state.camera
    corners = state.board_shape.corners_xyz(board)[ids]
    projected, J = cv2.projectPoints(corners, pose[:3], pose[3:], camera.K, camera.distortion)
    R, _ = cv2.Rodrigues(pose[:3])
    by_corner = (J[:, 3:6] @ R).reshape(-1, 2, 3)
    common = np.zeros((2 * len(ids), order.count))
    common[:, order.intrinsics] = J[:, 6 : 6 + order.intrinsic_count]
    shape = state.board_shape.jacobian(board.corners_xyz[ids, :2])
    common[:, order.shape] = (by_corner @ shape).reshape(-1, 4)
    pixels = np.asarray(picture.corners.uv - projected.reshape(-1, 2), dtype=np.float64)
    return _corner_residuals(pixels, common, np.asarray(J[:, :6], dtype=np.float64))


def _corner_residuals(pixels: Floats, common: Floats, local: Floats) -> PictureResiduals:
    values = pixels.ravel()
    ones, none = np.ones(len(values)), np.zeros((len(values), 0))
    return PictureResiduals(
        values=values, common=common, local=np.asarray(local), pixel_sigma=ones, shapes=none
    )


def board_stripe_residuals(
    state: JointState, order: ParameterOrder, stripe: StripePixels, pose: Floats
) -> PictureResiduals:
    """Return the (n,) distances of a stripe on a board from its laser plane, meters."""
    camera, laser = state.camera, state.lasers[stripe.laser]

    def distance(rays: Floats, pose: Floats, shape: BoardShape) -> Floats:
        return laser.distance(_board_pose(pose, shape).intersect(rays))

    rays, shape = camera.rays(stripe.uv), state.board_shape
    points = _board_pose(pose, shape).intersect(rays)
    values = laser.distance(points)
    common = np.zeros((len(values), order.count))
    by_uv = _by_pixels(camera, stripe.uv, lambda moved: distance(moved, pose, shape))
    common[:, order.intrinsics] = _by_intrinsics(camera, rays, by_uv)
    # the stretch moves no point off the board; the bend of a flat board is not estimated
    for column in range(0 if shape.is_flat else 3):
        step = shape.coefficients + _SHAPE_STEP * np.eye(4)[column]
        bent = BoardShape(center=shape.center, coefficients=step)
        moved = distance(rays, pose, bent)
        common[:, order.shape.start + column] = (moved - values) / _SHAPE_STEP
    common[:, order.laser(stripe.laser)] = _by_plane(laser, points)
    local = [(distance(rays, pose + _STEP * unit, shape) - values) / _STEP for unit in np.eye(6)]
    across = 0 if laser.stripe == 'rows' else 1
    return PictureResiduals(
        values=-values,
        common=common,
        local=np.stack(local, axis=1),
        pixel_sigma=stripe.sigma * np.abs(by_uv[:, across]),
        shapes=error_shapes(points),
    )


def _board_pose(pose: Floats, shape: BoardShape) -> BoardPose:
    return BoardPose(pose=pose, covariance=np.zeros((6, 6)), board_shape=shape, rms=0.0)


def _by_pixels(camera: Camera, uv: Floats, function: Callable[[Floats], Floats]) -> Floats:
    """Return (n, 2): derivative of a function of rays by the pixel they belong to."""
    columns = []
    for unit in np.eye(2):
        ahead, behind = (camera.rays(uv + s * _PIXEL_STEP * unit) for s in (1, -1))
        columns.append((function(ahead) - function(behind)) / (2 * _PIXEL_STEP))
    return np.stack(columns, axis=1)


def _by_intrinsics(camera: Camera, rays: Floats, by_uv: Floats) -> Floats:
    """Return (n, intrinsics): a change of the projection is one of the pixel, reversed."""
    return np.asarray(-np.einsum('nu,nui->ni', by_uv, intrinsics_jacobian(camera, rays)))


def _by_plane(laser: LaserPlane, points: Floats) -> Floats:
    """Return (n, 6): derivative of the distances from a laser plane by its parameters."""
    unit = np.zeros((len(points), 6))
    for column in range(3):
        step = np.zeros(6)
        step[column] = _STEP
        ahead, behind = (moved_laser(laser, s * step).distance(points) for s in (1, -1))
        unit[:, column] = (ahead - behind) / (2 * _STEP)
    if laser.bow is not None:
        unit[:, 3:] = -bow_basis(laser.bow, laser.normal, points)
    return unit


def platter_corner_residuals(
    state: JointState, order: ParameterOrder, seen: PlatterCorners
) -> PictureResiduals:
    """
    Return the (2n,) residuals of the corners of all pictures of the platter, pixels.

    ``local`` is (2n, 1), the derivative by the angle of the picture of each corner.
    """
    axis, camera = state.axis, state.camera
    points = axis.corners_in_camera(seen.corners)
    zero = np.zeros(3)
    projected, J = cv2.projectPoints(points, zero, zero, camera.K, camera.distortion)
    by_point = J[:, 3:6].reshape(-1, 2, 3)
    bloom = seen.corners.bloom_jacobian
    pixels = seen.pixels - projected.reshape(-1, 2) - axis.bloom * bloom
    still, none = np.zeros(len(axis.angles)), np.zeros(order.axis.stop - order.axis.start)

    def moves(common: Floats, angles: Floats) -> Floats:
        ahead, behind = (
            apply_axis_step(axis, s * common, s * angles).corners_in_camera(seen.corners)
            for s in (1, -1)
        )
        change = (ahead - behind) / (2 * _STEP)
        return np.asarray(np.einsum('nux,nx->nu', by_point, change).ravel())

    common = np.zeros((pixels.size, order.count))
    common[:, order.intrinsics] = J[:, 6 : 6 + order.intrinsic_count]
    for column in range(len(none)):
        step = none.copy()
        step[column] = _STEP
        common[:, order.axis.start + column] = moves(step, still)
    common[:, order.axis.start + 8] += bloom.ravel()
    local = moves(none, still + _STEP)[:, None]
    return _corner_residuals(pixels, common, local)


def platter_stripe_residuals(
    state: JointState, order: ParameterOrder, stripe: StripePixels
) -> PictureResiduals:
    """Return the (n,) heights of a stripe above the bare platter, with reversed sign, meters."""
    camera, laser = state.camera, state.lasers[stripe.laser]
    up = state.axis.camera_from_base[:3, 2]

    def height(rays: Floats, plane: LaserPlane) -> Floats:
        return state.axis.heights(plane.intersect(rays))

    rays = camera.rays(stripe.uv)
    points = laser.intersect(rays)
    values = state.axis.heights(points)
    common = np.zeros((len(values), order.count))
    by_uv = _by_pixels(camera, stripe.uv, lambda moved: height(moved, laser))
    common[:, order.intrinsics] = _by_intrinsics(camera, rays, by_uv)
    by_distance = -(rays @ up / (rays @ laser.normal))[:, None]
    common[:, order.laser(stripe.laser)] = by_distance * _by_plane(laser, points)
    base = transforms.apply(transforms.invert(state.axis.camera_from_base), points)
    first = order.axis.start
    common[:, first : first + 2] = np.stack([-base[:, 1], base[:, 0]], axis=1)
    common[:, first + 4] = -1.0
    across = 0 if laser.stripe == 'rows' else 1
    return PictureResiduals(
        values=-values,
        common=common,
        local=np.zeros((len(values), 0)),
        pixel_sigma=stripe.sigma * np.abs(by_uv[:, across]),
        shapes=error_shapes(points),
    )
