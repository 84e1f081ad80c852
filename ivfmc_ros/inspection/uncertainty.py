# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measurement uncertainty of points and fitted shapes due to the calibration (GUM, JCGM 100).

Noise averages out over many points; errors of the calibration are systematic and do not. Each
principal direction of the calibration's covariances is perturbed, the points are triangulated
again from their pixels, and the change is propagated to the measured quantity.
"""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.deviation import deviated
from ivfmc_ros.cell.deviation import independent_deviations
from ivfmc_ros.cell.visibility import faces_camera
from ivfmc_ros.cell.visibility import lit_angles
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Step of the numerical derivative, in standard deviations along a principal direction of a
# covariance.
_STEP = 1e-3
# Step of the derivative of a fitted quantity, in standard deviations.
_MEASURE_STEP = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationModes:
    """
    Displacement of n points by one standard deviation of each independent calibration error.

    shifts : (k, n, 3) meters; the k errors are independent, so that their squares add up
    sources : (k,) what of the cell errs: camera, laser planes or table axis
    """

    shifts: Floats
    sources: tuple[str, ...] = ()

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
            columns = np.concatenate([np.cross(lever, normals), normals], axis=1)
            moves = _without_rigid(columns, moves)[1]
        return np.asarray(np.linalg.norm(moves, axis=1))


def calibration_modes(cell: Cell, points_xyz: Floats, normals: Floats) -> CalibrationModes:
    """
    Return the displacements of points by the calibration errors of a cell.

    Without covariances in the cell, ``shifts`` is (0, n, 3).

    points_xyz : (n, 3) meters in ``turntable``
    normals : (n, 3) of the surface, to find the table angles at which the camera saw each point
    """
    erring = list(_erring_cells(cell))
    shifts = [_shift(cell, other, points_xyz, normals) for _, other in erring]
    if not shifts:
        return CalibrationModes(shifts=np.zeros((0, len(points_xyz), 3)))
    return CalibrationModes(
        shifts=np.stack(shifts) / _STEP, sources=tuple(source for source, _ in erring)
    )


def _erring_cells(cell: Cell) -> Iterator[tuple[str, Cell]]:
    """Yield what errs, and the cell with a small part of one independent error."""
    if cell.covariance is not None:
        # camera, laser planes and axis err together: their parts are not independent
        for source, direction in independent_deviations(cell.covariance):
            yield source, deviated(cell, _STEP * direction)
        return
    zeros = [np.zeros(4 + len(cell.camera.distortion)), *([np.zeros(4)] * len(cell.lasers))]
    parts = [*zeros, np.zeros(6)]
    covariances = [
        cell.camera.covariance,
        *(laser.covariance for laser in cell.lasers),
        cell.turntable.covariance,
    ]
    sources = ['camera', *(['laser planes'] * len(cell.lasers)), 'table axis']
    for place, (source, covariance) in enumerate(zip(sources, covariances, strict=True)):
        for direction in () if covariance is None else _principal_deviations(covariance):
            step = [*parts[:place], _STEP * direction, *parts[place + 1 :]]
            yield source, deviated(cell, np.concatenate(step))


def _principal_deviations(covariance: Floats) -> Floats:
    """Return standard deviations along the principal directions of a covariance, without zeros."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = values > 1e-12 * max(float(values.max()), 0.0)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _shift(cell: Cell, other: Cell, points: Floats, normals: Floats) -> Floats:
    """Return the displacement of points if images of ``cell`` are triangulated with ``other``."""
    total, count = np.zeros(points.shape), np.zeros(len(points))
    for index in range(len(cell.lasers)):
        for angle in lit_angles(cell, index, points):
            there, found = _retriangulated(cell, other, index, points, angle)
            seen = found & faces_camera(cell, points, normals, angle)
            total[seen] += (there - points)[seen]
            count += seen
    return np.asarray(total / np.maximum(count, 1.0)[:, None])


def _retriangulated(
    cell: Cell, other: Cell, laser: int, points: Floats, angle: Floats
) -> tuple[Floats, Bools]:
    turns = transforms.rotation_z(np.nan_to_num(angle))
    base = np.einsum('nij,nj->ni', turns, points)
    camera = transforms.apply(cell.turntable.camera_from_base, base)
    rays = camera / camera[:, 2:]
    seen = rays
    if other.camera is not cell.camera:
        seen = other.camera.rays(cell.camera.project(rays))
    # without the bow of the laser plane: it moves with the plane and cancels
    flat = replace(cell.lasers[laser], bow=None)
    with np.errstate(invalid='ignore', divide='ignore'):
        moved = replace(other.lasers[laser], bow=None).intersect(seen) - flat.intersect(rays)
    base = transforms.apply(transforms.invert(other.turntable.camera_from_base), camera + moved)
    back = np.einsum('nji,nj->ni', turns, base)
    return back, np.isfinite(back).all(axis=1)


# Vertices at which the displacements are computed; between them they are smooth.
_MAX_MODEL_POINTS = 20_000
# Meters by which the nearest vertex may be farther if its normal is that of the other: the cameras
# and lasers that see a vertex depend on its normal.
_NORMAL_LENGTH = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationModel:
    """
    Displacement of the points of one mesh by the errors of the cell that measured it.

    cell : None if it is not known
    center : (3,) meters, and rigid : (k, 6) rotation and translation, which the alignment of the
        mesh to the nominal absorbs, of each of the k independent errors
    along_normals : (n,) meters, standard uncertainty of the vertices; NaN if it is not known
    """

    cell: Cell | None
    center: Floats
    rigid: Floats
    along_normals: Floats

    @classmethod
    def of(
        cls, cell: Cell | None, points_xyz: Floats, normals: Floats, *, aligned: bool
    ) -> 'CalibrationModel':
        """
        Compute the displacements of the vertices (n, 3) of a mesh with normals (n, 3).

        aligned : the alignment to a nominal absorbs rigid displacements
        """
        chosen = np.arange(0, len(points_xyz), max(1, len(points_xyz) // _MAX_MODEL_POINTS))
        points, n = points_xyz[chosen], normals[chosen]
        center = points.mean(axis=0)
        unknown = np.full(len(points_xyz), np.nan)
        nothing = cls(cell=cell, center=center, rigid=np.zeros((0, 6)), along_normals=unknown)
        if cell is None:
            return nothing
        modes = calibration_modes(cell, points, n)
        if not len(modes.shifts):
            return nothing
        moves = np.einsum('knc,nc->nk', modes.shifts, n)
        rigid = np.zeros((len(modes.shifts), 6))
        if aligned:
            columns = np.concatenate([np.cross(points - center, n), n], axis=1)
            rigid, moves = _without_rigid(columns, moves)
        size = np.linalg.norm(moves, axis=1)
        known = size[_nearest(points, n, points_xyz, normals)]
        return cls(cell=cell, center=center, rigid=rigid, along_normals=known)

    def modes(self, points_xyz: Floats, normals: Floats) -> CalibrationModes | None:
        """Return the displacements of points (n, 3) that remain after the alignment, or None."""
        if self.cell is None or not len(self.rigid):
            return None
        modes = calibration_modes(self.cell, points_xyz, normals)
        lever = points_xyz - self.center
        turned = np.cross(self.rigid[:, None, :3], lever[None]) + self.rigid[:, None, 3:]
        return replace(modes, shifts=modes.shifts - turned)


def _without_rigid(columns: Floats, moves: Floats) -> tuple[Floats, Floats]:
    """Return the rigid motions (k, 6) that fit moves (n, k), and what remains of these."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
    solved = np.linalg.lstsq(columns / scale, moves, rcond=1e-6)[0] / scale[:, None]
    return solved.T, moves - columns @ solved


def _nearest(points: Floats, normals: Floats, queries: Floats, their_normals: Floats) -> Ints:
    tree = cKDTree(np.concatenate([points, _NORMAL_LENGTH * normals], axis=1))
    both = np.concatenate([queries, _NORMAL_LENGTH * their_normals], axis=1)
    return np.asarray(tree.query(both, workers=-1)[1])
