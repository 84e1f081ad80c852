# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How far measured points and what is fitted to them may be off (GUM, JCGM 100).

Noise averages out over many points; the calibration moves all of them together and does not. So
every parameter of the calibration that has a covariance is moved a little, the points are
triangulated anew from where the camera saw them, and what is measured is measured again.
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
# A surface that turns farther away than this (cosine) was not measured from there.
_LEAST_FACING = 0.1
_STEP = 1e-3  # of one standard deviation along each principal direction of a covariance


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """
    What a length depends on beside the points.

    scale_u : relative, 1 sigma, of the known length of the calibration
    temperature, temperature_u : degrees Celsius of the part, and 1 sigma
    expansion, expansion_u : 1/K and its 1 sigma; steel by default
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
        """What a length is multiplied with to be that at 20 degrees."""
        return 1.0 / (1.0 + self.expansion * (self.temperature - REFERENCE_TEMPERATURE))

    @property
    def relative_u(self) -> float:
        """Relative standard uncertainty of a length, of scale and temperature."""
        warm = self.temperature - REFERENCE_TEMPERATURE
        return float(
            np.linalg.norm(
                [self.scale_u, self.expansion * self.temperature_u, warm * self.expansion_u]
            )
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """
    How points move by one standard deviation of each independent cause.

    shifts : (causes, n, 3) metres; their squares add up
    """

    shifts: Floats

    def of(self, measure: Callable[[Floats], float], points_xyz: Floats) -> float:
        """Return the standard uncertainty that the causes give what ``measure`` says of points."""
        value = measure(points_xyz)
        small = 0.05
        moves = [(measure(points_xyz + small * shift) - value) / small for shift in self.shifts]
        return float(np.linalg.norm(moves)) if moves else 0.0

    def along(self, points_xyz: Floats, normals: Floats, fitted: bool) -> Floats:
        """
        Return (n,) standard uncertainty of the points along their normals.

        fitted : the points were laid onto a nominal, which takes up what moves them as a whole
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


def calibration_modes(cell: Cell, points_xyz: Floats, normals: Floats) -> Modes:
    """
    Return how (n, 3) points in ``turntable`` move with the calibration of a cell.

    A cell without covariances moves none: then ``shifts`` is (0, n, 3).

    normals : (n, 3) of the surface there, which tell from which side a point was seen
    """
    shifts = []
    pose = cell.turntable.covariance
    if pose is not None:
        for direction in _roots(pose):
            T = cell.turntable.camera_from_base
            turn = Rotation.from_rotvec(_STEP * direction[3:]).as_matrix()
            moved = transforms.rigid(turn @ T[:3, :3], T[:3, 3] + _STEP * direction[:3])
            other = replace(cell, turntable=replace(cell.turntable, camera_from_base=moved))
            shifts.append(_shift(cell, other, points_xyz, normals))
    for index, laser in enumerate(cell.lasers):
        if laser.covariance is None:
            continue
        for direction in _roots(laser.covariance):
            normal = laser.normal + _STEP * direction[:3]
            size = np.linalg.norm(normal)
            offset = (laser.offset + _STEP * direction[3]) / size
            bent = replace(laser, normal=normal / size, offset=float(offset), bow=None)
            lasers = (*cell.lasers[:index], bent, *cell.lasers[index + 1 :])
            shifts.append(_shift(cell, replace(cell, lasers=lasers), points_xyz, normals))
    if not shifts:
        return Modes(shifts=np.zeros((0, len(points_xyz), 3)))
    return Modes(shifts=np.stack(shifts) / _STEP)


def _roots(covariance: Floats) -> Floats:
    """Return one standard deviation along each principal direction, without those of none."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = values > 1e-12 * max(float(values.max()), 0.0)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _shift(cell: Cell, other: Cell, points: Floats, normals: Floats) -> Floats:
    """Return where points go when pictures taken with ``cell`` are evaluated with ``other``."""
    total, count = np.zeros(points.shape), np.zeros(len(points))
    for index in range(len(cell.lasers)):
        for angle in _angles(cell, index, points):
            there, found = _evaluated(cell, other, index, points, angle)
            seen = found & _is_seen(cell, points, normals, angle)
            total[seen] += (there - points)[seen]
            count += seen
    return np.asarray(total / np.maximum(count, 1.0)[:, None])


def _angles(cell: Cell, laser: int, points: Floats) -> Floats:
    """Return (2, n) table angles at which points lie in the plane of a laser; NaN if never."""
    T = cell.turntable.camera_from_base
    sheet = cell.lasers[laser]
    normal = T[:3, :3].T @ sheet.normal
    offset = sheet.offset + float(sheet.normal @ T[:3, 3]) + normal[2] * points[:, 2]
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
    near = facing > _LEAST_FACING * np.linalg.norm(sight, axis=1)
    return np.asarray(np.isfinite(angle) & near)


def _evaluated(
    cell: Cell, other: Cell, laser: int, points: Floats, angle: Floats
) -> tuple[Floats, Bools]:
    turns = transforms.rotation_z(np.nan_to_num(angle))
    base = np.einsum('nij,nj->ni', turns, points)
    camera = transforms.apply(cell.turntable.camera_from_base, base)
    rays = camera / camera[:, 2:]
    # the difference to the plane of the same laser: a bow moves with it
    flat = replace(cell.lasers[laser], bow=None)
    with np.errstate(invalid='ignore', divide='ignore'):
        moved = replace(other.lasers[laser], bow=None).intersect(rays) - flat.intersect(rays)
    base = transforms.apply(transforms.invert(other.turntable.camera_from_base), camera + moved)
    back = np.einsum('nji,nj->ni', turns, base)
    return back, np.isfinite(back).all(axis=1)
