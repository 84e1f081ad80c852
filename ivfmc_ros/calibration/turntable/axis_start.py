# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A first guess of axis, layout and angles, good enough for the joint adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.turntable.axis import Axis
from ivfmc_ros.calibration.turntable.axis import Sightings
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    """One thing in one picture: (2,) place and yaw on the platter's plane."""

    picture: int
    group: int
    place: Floats
    yaw: float


def start_axis(sightings: Sightings, focal: Floats, where: str) -> Axis:
    """
    Guess from the pose of each thing in each picture by itself.

    The plane through all of them is the platter's, whose normal is the axis' direction. On that
    plane each thing has a place and a yaw; the yaws give the angles, then the places the axis.

    :raises CalibrationError: the pictures are not linked by common markers, or do not turn
    """
    plane = _platter_plane(sightings, focal)
    seen = _on_plane(sightings, focal, plane)
    angles, yaws = _chain(seen, sightings, where)
    center, places = _center(seen, angles, len(yaws), where)
    T = plane @ transforms.rigid(np.eye(3), np.append(center, 0.0))
    return Axis(
        camera_from_base=T,
        tilt=np.zeros(2),
        scale=1.0,
        layout=np.column_stack([places, yaws]),
        angles=angles,
    )


def _platter_plane(sightings: Sightings, focal: Floats) -> Floats:
    """Return (4, 4) camera_from_plane, z towards the camera."""
    points = []
    for chosen in _pairs(sightings):
        local, uv = sightings.local_xyz[chosen], sightings.uv[chosen]
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


def _pairs(sightings: Sightings) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return the rows of each thing in each picture."""
    key = sightings.picture * (sightings.group.max() + 1) + sightings.group
    order = np.argsort(key, kind='stable')
    return np.split(order, np.flatnonzero(np.diff(key[order])) + 1)


def _on_plane(sightings: Sightings, focal: Floats, plane: Floats) -> list[_Seen]:
    back = transforms.invert(plane)
    seen = []
    for chosen in _pairs(sightings):
        rays = np.column_stack([sightings.uv[chosen] / focal, np.ones(len(chosen))])
        directions, origin = rays @ back[:3, :3].T, back[:3, 3]
        xy = (origin - directions * (origin[2] / directions[:, 2])[:, None])[:, :2]
        local = sightings.local_xyz[chosen][:, :2]
        a, b = local - local.mean(axis=0), xy - xy.mean(axis=0)
        yaw = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
        turned = transforms.rotation_z(yaw)[:2, :2] @ local.mean(axis=0)
        first = chosen[0]
        seen.append(
            _Seen(
                picture=int(sightings.picture[first]),
                group=int(sightings.group[first]),
                place=xy.mean(axis=0) - turned,
                yaw=float(yaw),
            )
        )
    return seen


def _chain(seen: Sequence[_Seen], sightings: Sightings, where: str) -> tuple[Floats, Floats]:
    """Return the angle of each picture and the yaw of each thing at angle 0 of the first."""
    angles = np.full(int(sightings.picture.max()) + 1, np.nan)
    yaws = np.full(int(sightings.group.max()) + 1, np.nan)
    angles[seen[0].picture] = 0.0
    for _ in range(len(angles) + len(yaws)):
        before = np.isnan(angles).sum() + np.isnan(yaws).sum()
        yaws = _mean_angles(len(yaws), [(s.group, s.yaw - angles[s.picture]) for s in seen])
        angles = _mean_angles(len(angles), [(s.picture, s.yaw - yaws[s.group]) for s in seen])
        if np.isnan(angles).sum() + np.isnan(yaws).sum() == before:
            break
    if np.isnan(angles).any():
        raise CalibrationError(
            f'{where}: the pictures fall into groups that have no marker in common; '
            'take pictures at more table angles between them'
        )
    return angles, yaws


def _mean_angles(count: int, pairs: Sequence[tuple[int, float]]) -> Floats:
    total = np.zeros(count, dtype=complex)
    for index, angle in pairs:
        if not np.isnan(angle):
            total[index] += np.exp(1j * angle)
    return np.where(total == 0, np.nan, np.angle(total))


def _center(
    seen: Sequence[_Seen], angles: Floats, groups: int, where: str
) -> tuple[Floats, Floats]:
    """Return the axis' place on the plane, (2,), and the (groups, 2) places about it."""
    design = np.zeros((len(seen), 2, 2 + 2 * groups))
    design[:, :, :2] = np.eye(2)
    for row, thing in zip(design, seen, strict=True):
        column = 2 + 2 * thing.group
        row[:, column : column + 2] = transforms.rotation_z(angles[thing.picture])[:2, :2]
    right = np.concatenate([thing.place for thing in seen])
    matrix = design.reshape(2 * len(seen), -1)
    solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-6)
    if rank < matrix.shape[1]:
        raise CalibrationError(
            f'{where}: the table did not turn between the pictures; '
            'take pictures at 8 or more angles all around'
        )
    return solution[:2], solution[2:].reshape(-1, 2)
