# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint covariance of all calibrated parameters of a cell, and its effect on measured points."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats

# Names of the intrinsic parameters, in OpenCV's order.
INTRINSIC_NAMES = ('fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6')
PLANE_NAMES = ('nx', 'ny', 'nz', 'd')
AXIS_NAMES = ('tx', 'ty', 'tz', 'rx', 'ry', 'rz')
# An eigenvalue of a covariance may be negative by this fraction of the greatest: rounding of text.
_ROUNDING = 1e-6


def parameter_names(camera: Camera, lasers: Sequence[str]) -> tuple[str, ...]:
    """
    Return the names of the parameters of a cell, in the order of their covariance.

    lasers : names of the lasers
    returns : intrinsics (pixels; distortion without unit), for each laser ``<name>.nx`` to
        ``<name>.d`` (unit normal and meters), then ``axis.tx`` to ``axis.rz`` (translation in
        meters and rotation vector in radians of ``camera_from_base``, in camera_optical_frame)
    """
    intrinsics = INTRINSIC_NAMES[: 4 + len(camera.distortion)]
    planes = [f'{laser}.{part}' for laser in lasers for part in PLANE_NAMES]
    return (*intrinsics, *planes, *(f'axis.{part}' for part in AXIS_NAMES))


@dataclass(frozen=True, eq=False, kw_only=True)
class CellCovariance:
    """
    Covariance of camera, laser planes and axis, from one adjustment of all pictures.

    parameters : (p,) names, from ``parameter_names``
    matrix : (p, p) for an exactly known length of the board
    scale_u : relative standard uncertainty of the length that gives the scale; None if it is not
        known. It is common to all lengths and not contained in ``matrix``
    :raises CellError: the matrix has another size, is not symmetric or not positive semidefinite
    """

    parameters: tuple[str, ...]
    matrix: Floats
    scale_u: float | None = None

    def __post_init__(self) -> None:
        count = len(self.parameters)
        if self.matrix.shape != (count, count) or not np.isfinite(self.matrix).all():
            raise CellError(f'covariance: matrix: {count} x {count} finite numbers are needed')
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        unit = self.matrix / np.outer(scale, scale)
        if np.abs(unit - unit.T).max() > _ROUNDING:
            raise CellError('covariance: matrix: is not symmetric')
        if np.linalg.eigvalsh(unit).min() < -_ROUNDING * count:
            raise CellError('covariance: matrix: is not positive semidefinite')
        if self.scale_u is not None and not 0.0 <= self.scale_u < 0.1:
            raise CellError('covariance: scale_u: must be from 0 to 0.1')

    def block(self, names: Sequence[str]) -> Floats:
        """Return the (n, n) covariance of the named parameters."""
        index = [self.parameters.index(name) for name in names]
        return self.matrix[np.ix_(index, index)]

    def block_for_known(self, names: Sequence[str], known: Sequence[str]) -> Floats:
        """Return the (n, n) covariance of named parameters if others, ``known``, were exact."""
        rows = [self.parameters.index(name) for name in names]
        fixed = [self.parameters.index(name) for name in known]
        scale = np.sqrt(np.maximum(np.diag(self.matrix)[fixed], 1e-300))
        coupling = self.matrix[np.ix_(rows, fixed)] / scale
        inner = np.linalg.pinv(self.block(known) / np.outer(scale, scale), hermitian=True)
        left = self.block(names) - coupling @ inner @ coupling.T
        return np.asarray(0.5 * (left + left.T))

    def deviations(self) -> Floats:
        """Return (k, p): independent deviations of one sigma each, whose squares add up."""
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        unit = np.where(scale > 0, scale, 1.0)
        values, vectors = np.linalg.eigh(self.matrix / np.outer(unit, unit))
        kept = values > 1e-12 * max(float(values.max()), 0.0)
        return np.asarray((scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])).T)


def intrinsic_names(covariance: CellCovariance) -> tuple[str, ...]:
    """Return the names of the intrinsics in a covariance."""
    return tuple(name for name in covariance.parameters if name in INTRINSIC_NAMES)


def intrinsics_jacobian(camera: Camera, rays: Floats) -> Floats:
    """Return (n, 2, 4 + distortion): derivative of the projection of rays by the intrinsics."""
    zero = np.zeros(3)
    _, J = cv2.projectPoints(rays.reshape(-1, 1, 3), zero, zero, camera.K, camera.distortion)
    count = 4 + len(camera.distortion)
    return np.asarray(J[:, 6 : 6 + count], dtype=np.float64).reshape(-1, 2, count)


def point_jacobian(
    camera: Camera,
    plane: tuple[Floats, float],
    camera_from_base: Floats,
    uv: Floats,
    angle: float,
) -> Floats:
    """
    Return the derivative of triangulated points by the calibration of the cell.

    plane : unit normal and offset of the laser; a bow moves with its plane
    uv : (n, 2) pixels of the stripe
    angle : table position, radians
    returns : (n, 3, 4 + distortion + 4 + 6): of the points in ``turntable``, by intrinsics, plane
        (nx, ny, nz, d) and ``camera_from_base`` (translation, rotation vector)
    """
    rays = camera.rays(uv)
    normal, offset = plane
    facing = rays @ normal
    depth = -offset / facing
    by_uv = np.stack([camera.ray_jacobian(rays, 'u'), camera.ray_jacobian(rays, 'v')], axis=2)
    by_intrinsics = -by_uv @ intrinsics_jacobian(camera, rays)
    # X = depth ray with depth = -d / n.ray
    project = np.eye(3) - rays[:, :, None] * normal / facing[:, None, None]
    points = rays * depth[:, None]
    moves = depth[:, None, None] * project @ by_intrinsics
    by_plane = np.empty((len(rays), 3, 4))
    by_plane[:, :, :3] = -rays[:, :, None] * (depth / facing)[:, None, None] * rays[:, None]
    by_plane[:, :, 3] = -rays / facing[:, None]
    to_part = transforms.rotation_z(-angle) @ camera_from_base[:3, :3].T
    lever = points - camera_from_base[:3, 3]
    by_turn = np.zeros((len(rays), 3, 3))
    by_turn[:, 0, 1], by_turn[:, 0, 2], by_turn[:, 1, 2] = -lever[:, 2], lever[:, 1], -lever[:, 0]
    by_turn -= np.swapaxes(by_turn, 1, 2)
    shift = np.broadcast_to(-np.eye(3), by_turn.shape)
    return np.asarray(to_part @ np.concatenate([moves, by_plane, shift, by_turn], axis=2))
