# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Initial axis, layout and table angles from the pose of each target in each picture (PnP)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class _PlanarPose:
    """One target in one picture: (2,) meters and yaw in radians on the plane of the platter."""

    picture: int
    group: int
    position: Floats
    yaw: float


def initialize_axis(observations: CornerObservations, focal: Floats, where: str) -> AxisState:
    """
    Return an initial state from the separately estimated poses of the targets.

    The plane through all corners is the platter's; its normal is the direction of the axis. On
    that plane each target has a position and a yaw: the yaws give the table angles, then the
    positions give the axis.

    focal : (2,) fx, fy in pixels
    where : folder of the pictures, for messages
    :raises CalibrationError: the pictures are not linked by common targets, or the table did
        not turn
    """
    plane = _platter_plane(observations, focal)
    poses = _poses_on_plane(observations, focal, plane)
    angles, yaws = _propagate_angles(poses, observations, where)
    center, positions = _center(poses, angles, len(yaws), where)
    T = plane @ transforms.rigid(np.eye(3), np.append(center, 0.0))
    return AxisState(
        camera_from_base=T,
        tilt=np.zeros(2),
        scale=1.0,
        layout=np.column_stack([positions, yaws]),
        angles=angles,
    )


def _platter_plane(observations: CornerObservations, focal: Floats) -> Floats:
    """Return (4, 4) camera_from_plane, z towards the camera."""
    points = []
    for rows in _rows_by_target(observations):
        local, uv = observations.local_xyz[rows], observations.uv[rows]
        found, turn, shift = cv2.solvePnP(
            local, (uv / focal).reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        if found:
            points.append(local @ cv2.Rodrigues(turn)[0].T + shift.ravel())
    cloud = np.concatenate(points)
    center = np.median(cloud, axis=0)
    for _ in range(5):
        normal = np.linalg.svd(cloud - center, full_matrices=False)[2][2]
        off = np.abs((cloud - center) @ normal)
        cloud = cloud[off <= max(3 * np.median(off), 1e-9)]
        center = cloud.mean(axis=0)
    normal = -np.sign(normal @ center) * normal
    x = np.cross(normal, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return transforms.rigid(np.stack([x, np.cross(normal, x), normal], axis=1), center)


def _rows_by_target(
    observations: CornerObservations,
) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return the rows of each target in each picture."""
    key = observations.picture * (observations.group.max() + 1) + observations.group
    order = np.argsort(key, kind='stable')
    return np.split(order, np.flatnonzero(np.diff(key[order])) + 1)


def _poses_on_plane(
    observations: CornerObservations, focal: Floats, plane: Floats
) -> list[_PlanarPose]:
    back = transforms.invert(plane)
    poses = []
    for rows in _rows_by_target(observations):
        rays = np.column_stack([observations.uv[rows] / focal, np.ones(len(rows))])
        directions, origin = rays @ back[:3, :3].T, back[:3, 3]
        xy = (origin - directions * (origin[2] / directions[:, 2])[:, None])[:, :2]
        local = observations.local_xyz[rows][:, :2]
        a, b = local - local.mean(axis=0), xy - xy.mean(axis=0)
        yaw = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
        turned = transforms.rotation_z(yaw)[:2, :2] @ local.mean(axis=0)
        first = rows[0]
        poses.append(
            _PlanarPose(
                picture=int(observations.picture[first]),
                group=int(observations.group[first]),
                position=xy.mean(axis=0) - turned,
                yaw=float(yaw),
            )
        )
    return poses


def _propagate_angles(
    poses: Sequence[_PlanarPose], observations: CornerObservations, where: str
) -> tuple[Floats, Floats]:
    """Return the angle of each picture, 0 for the first, and the yaw of each target at angle 0."""
    angles = np.full(int(observations.picture.max()) + 1, np.nan)
    yaws = np.full(int(observations.group.max()) + 1, np.nan)
    angles[poses[0].picture] = 0.0
    for _ in range(len(angles) + len(yaws)):
        before = np.isnan(angles).sum() + np.isnan(yaws).sum()
        yaws = _mean_angles(len(yaws), [(s.group, s.yaw - angles[s.picture]) for s in poses])
        angles = _mean_angles(len(angles), [(s.picture, s.yaw - yaws[s.group]) for s in poses])
        if np.isnan(angles).sum() + np.isnan(yaws).sum() == before:
            break
    if np.isnan(angles).any():
        raise CalibrationError(
            f'{where}: the pictures fall into groups that have no marker in common; '
            'take pictures at more table angles, so that each shares markers with the next'
        )
    return angles, yaws


def _mean_angles(count: int, samples: Sequence[tuple[int, float]]) -> Floats:
    total = np.zeros(count, dtype=complex)
    for index, angle in samples:
        if not np.isnan(angle):
            total[index] += np.exp(1j * angle)
    return np.where(total == 0, np.nan, np.angle(total))


def _center(
    poses: Sequence[_PlanarPose], angles: Floats, groups: int, where: str
) -> tuple[Floats, Floats]:
    """Return the axis' position on the plane, (2,) meters, and the (groups, 2) of the targets."""
    design = np.zeros((len(poses), 2, 2 + 2 * groups))
    design[:, :, :2] = np.eye(2)
    for row, target in zip(design, poses, strict=True):
        column = 2 + 2 * target.group
        row[:, column : column + 2] = transforms.rotation_z(angles[target.picture])[:2, :2]
    right = np.concatenate([target.position for target in poses])
    matrix = design.reshape(2 * len(poses), -1)
    solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-6)
    if rank < matrix.shape[1]:
        raise CalibrationError(
            f'{where}: the table did not turn between the pictures; '
            'take pictures at 8 or more angles all around'
        )
    return solution[:2], solution[2:].reshape(-1, 2)
