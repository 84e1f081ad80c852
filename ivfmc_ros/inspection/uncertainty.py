# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measurement uncertainty of points and fitted shapes due to the calibration (GUM, JCGM 100).

Noise averages out over many points; errors of the calibration are systematic and do not. Each
principal direction of the calibration's covariances is perturbed, the points are triangulated
again from their pixels, and the change is propagated to the measured quantity.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

REFERENCE_TEMPERATURE = 20.0  # degrees Celsius, ISO 1
# Minimum cosine between the normal and the direction to the camera of a point that is measured.
_MIN_FACING = 0.1
# Step of the numerical derivative, in standard deviations along a principal direction of a
# covariance.
_STEP = 1e-3
# Step of the derivative of a fitted quantity, in standard deviations.
_MEASURE_STEP = 0.05


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """
    Measurement conditions that scale all lengths.

    scale_u : relative standard uncertainty of the reference length of the calibration
    temperature, temperature_u : temperature of the part, degrees Celsius, and its standard
        uncertainty, K
    expansion, expansion_u : coefficient of thermal expansion and its standard uncertainty, 1/K;
        steel by default
    """

    scale_u: float = 0.0
    temperature: float = REFERENCE_TEMPERATURE
    temperature_u: float = 0.0
    expansion: float = 11.5e-6
    expansion_u: float = 1.0e-6

    def __post_init__(self) -> None:
        require_in_range('scale_u', self.scale_u, 0.0, 0.1)
        require_in_range('temperature', self.temperature, -50.0, 200.0, 'C')
        require_in_range('temperature_u', self.temperature_u, 0.0, 50.0, 'K')
        require_in_range('expansion', self.expansion, 0.0, 1e-3, '1/K')

    @property
    def to_reference(self) -> float:
        """Factor from a length at ``temperature`` to that at 20 degrees Celsius (ISO 1)."""
        return 1.0 / (1.0 + self.expansion * (self.temperature - REFERENCE_TEMPERATURE))

    @property
    def relative_u(self) -> float:
        """Relative standard uncertainty of a length due to scale and temperature."""
        difference = self.temperature - REFERENCE_TEMPERATURE
        return float(
            np.linalg.norm(
                [self.scale_u, self.expansion * self.temperature_u, difference * self.expansion_u]
            )
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationModes:
    """
    Displacement of n points by one standard deviation of each independent calibration error.

    shifts : (k, n, 3) meters; the k errors are independent, so that their squares add up
    """

    shifts: Floats

    def propagate(self, measure: Callable[[Floats], float], points_xyz: Floats) -> float:
        """Return the standard uncertainty of the quantity ``measure`` of points (n, 3)."""
        value = measure(points_xyz)
        moves = [
            (measure(points_xyz + _MEASURE_STEP * shift) - value) / _MEASURE_STEP
            for shift in self.shifts
        ]
        return float(np.linalg.norm(moves)) if moves else 0.0

    def along_normals(self, points_xyz: Floats, normals: Floats, fitted: bool) -> Floats:
        """
        Return the standard uncertainty of points along their normals, (n,) meters.

        fitted : the points were aligned to a nominal, which absorbs rigid displacements
        """
        if not len(self.shifts):
            return np.zeros(len(points_xyz))
        moves = np.einsum('knc,nc->nk', self.shifts, normals)
        if fitted:
            lever = points_xyz - points_xyz.mean(axis=0)
            rigid = np.concatenate([np.cross(lever, normals), normals], axis=1)
            scale = np.maximum(np.linalg.norm(rigid, axis=0), 1e-30)
            moves = moves - rigid @ (
                np.linalg.lstsq(rigid / scale, moves, rcond=1e-6)[0] / scale[:, None]
            )
        return np.asarray(np.linalg.norm(moves, axis=1))


def calibration_modes(cell: Cell, points_xyz: Floats, normals: Floats) -> CalibrationModes:
    """
    Return the displacements of points by the calibration errors of a cell.

    Without covariances in the cell, ``shifts`` is (0, n, 3).

    points_xyz : (n, 3) meters in ``turntable``
    normals : (n, 3) of the surface, to find the table angles at which the camera saw each point
    """
    shifts = []
    pose = cell.turntable.covariance
    if pose is not None:
        for direction in _principal_deviations(pose):
            T = cell.turntable.camera_from_base
            turn = Rotation.from_rotvec(_STEP * direction[3:]).as_matrix()
            moved = transforms.rigid(turn @ T[:3, :3], T[:3, 3] + _STEP * direction[:3])
            other = replace(cell, turntable=replace(cell.turntable, camera_from_base=moved))
            shifts.append(_shift(cell, other, points_xyz, normals))
    for index, laser in enumerate(cell.lasers):
        if laser.covariance is None:
            continue
        for direction in _principal_deviations(laser.covariance):
            normal = laser.normal + _STEP * direction[:3]
            size = np.linalg.norm(normal)
            offset = (laser.offset + _STEP * direction[3]) / size
            bent = replace(laser, normal=normal / size, offset=float(offset), bow=None)
            lasers = (*cell.lasers[:index], bent, *cell.lasers[index + 1 :])
            shifts.append(_shift(cell, replace(cell, lasers=lasers), points_xyz, normals))
    if not shifts:
        return CalibrationModes(shifts=np.zeros((0, len(points_xyz), 3)))
    return CalibrationModes(shifts=np.stack(shifts) / _STEP)


def _principal_deviations(covariance: Floats) -> Floats:
    """Return standard deviations along the principal directions of a covariance, without zeros."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = values > 1e-12 * max(float(values.max()), 0.0)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _shift(cell: Cell, other: Cell, points: Floats, normals: Floats) -> Floats:
    """Return the displacement of points if images of ``cell`` are triangulated with ``other``."""
    total, count = np.zeros(points.shape), np.zeros(len(points))
    for index in range(len(cell.lasers)):
        for angle in _angles(cell, index, points):
            there, found = _retriangulated(cell, other, index, points, angle)
            seen = found & _is_seen(cell, points, normals, angle)
            total[seen] += (there - points)[seen]
            count += seen
    return np.asarray(total / np.maximum(count, 1.0)[:, None])


def _angles(cell: Cell, laser: int, points: Floats) -> Floats:
    """Return the table angles (2, n) at which points lie in a laser plane; NaN if never."""
    T = cell.turntable.camera_from_base
    plane = cell.lasers[laser]
    normal = T[:3, :3].T @ plane.normal
    offset = plane.offset + float(plane.normal @ T[:3, 3]) + normal[2] * points[:, 2]
    a = normal[0] * points[:, 0] + normal[1] * points[:, 1]
    b = normal[1] * points[:, 0] - normal[0] * points[:, 1]
    size = np.hypot(a, b)
    with np.errstate(invalid='ignore', divide='ignore'):
        half = np.arccos(-offset / size)
    return np.stack([np.arctan2(b, a) + half, np.arctan2(b, a) - half])


def _is_seen(cell: Cell, points: Floats, normals: Floats, angle: Floats) -> Bools:
    eye = cell.turntable.to_part(np.zeros((1, 3)), 0.0)
    turns = transforms.rotation_z(-np.nan_to_num(angle))
    sight = (turns @ eye[0]) - points
    facing = (sight * normals).sum(axis=1)
    faces_camera = facing > _MIN_FACING * np.linalg.norm(sight, axis=1)
    return np.asarray(np.isfinite(angle) & faces_camera)


def _retriangulated(
    cell: Cell, other: Cell, laser: int, points: Floats, angle: Floats
) -> tuple[Floats, Bools]:
    turns = transforms.rotation_z(np.nan_to_num(angle))
    base = np.einsum('nij,nj->ni', turns, points)
    camera = transforms.apply(cell.turntable.camera_from_base, base)
    rays = camera / camera[:, 2:]
    # without the bow of the laser plane: it moves with the plane and cancels
    flat = replace(cell.lasers[laser], bow=None)
    with np.errstate(invalid='ignore', divide='ignore'):
        moved = replace(other.lasers[laser], bow=None).intersect(rays) - flat.intersect(rays)
    base = transforms.apply(transforms.invert(other.turntable.camera_from_base), camera + moved)
    back = np.einsum('nji,nj->ni', turns, base)
    return back, np.isfinite(back).all(axis=1)
