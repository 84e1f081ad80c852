# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Views as they were measured: pixel, table angle, laser.

A point follows from these and from the cell, so that a changed cell gives the changed point
exactly, and the derivative with it.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import View
from ivfmc_ros.registration.self_calibration.parameters import CellUnknowns
from ivfmc_ros.stripe.triangulate import sensitivity

# Steps to the table angle of a point, and the farthest that one may go, radians.
_NEWTON, _NEARBY = 3, 0.1
# By so many sigmas of its points a view may differ from what the cell makes of its pixels.
_SAME = 1e-6  # metres


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """
    The valid points of a view.

    rays : (n, 3) of unit depth, ``camera_optical_frame``; angles : (n,) radians as reported
    way : 1 if the table turned to rising angles, -1 to falling
    """

    view: View
    rays: Floats
    angles: Floats
    way: float

    def reported(self, angles: Floats) -> Floats:
        """Return (n,) of the valid points from the angles (columns,) of the profiles."""
        valid = self.view.valid
        return np.asarray(np.broadcast_to(angles, valid.shape)[valid])

    def points(self, unknowns: CellUnknowns, values: Floats, cell: Cell) -> Floats:
        """Return (n, 3) metres, ``turntable``; ``cell`` is the one that has the values."""
        angles = self.angles + unknowns.angle_error(values, self.angles, self.way)
        return turned_back(seen_from_base(self.rays, cell, self.view.laser), angles)


def measured(cell: Cell, view: View) -> Measured:
    """
    Return a view as it was measured.

    :raises GeometryError: its points are not what the cell makes of its pixels
    """
    valid = view.valid
    found = Measured(
        view=view,
        rays=cell.camera.rays(view.uv[valid]),
        angles=np.broadcast_to(view.angles, valid.shape)[valid],
        way=_way(view),
    )
    base = seen_from_base(found.rays, cell, view.laser)
    differ = np.abs(turned_back(base, found.angles) - view.points_xyz[valid])
    if differ.size and not differ.max() < _SAME:
        raise GeometryError(
            f'view {view.number}: its points are not what the cell makes of its pixels; '
            'refine with the cell that the scan was reconstructed with'
        )
    return found


def as_measured(found: Measured, cell: Cell, points_xyz: Floats, angles: Floats) -> Measured:
    """
    Return (n, 3) points of the surface, which nobody measured, as the view would have seen them.

    The slopes of a measured point nearby will not do: its table angle is another, and what two
    sweeps can tell of the angle is in the difference of theirs.

    angles : (n,) radians, of measured points nearby
    """
    laser, T = cell.lasers[found.view.laser], cell.turntable.camera_from_base
    for _ in range(_NEWTON):
        base = turned_back(points_xyz, -angles)
        seen = transforms.apply(T, base)
        rate = crossing_rate(cell, laser, base)
        step = np.divide(laser.distance(seen), rate, out=np.zeros(len(rate)), where=rate != 0)
        # next to the axis the sheet is met at any angle
        angles = angles - np.where(np.abs(step) < _NEARBY, step, 0.0)
    seen = transforms.apply(T, turned_back(points_xyz, -angles))
    return replace(found, rays=seen / seen[:, 2:], angles=angles)


def crossing_rate(cell: Cell, laser: LaserPlane, base_xyz: Floats) -> Floats:
    """Return (n,) metres a radian at which points of ``turntable_base`` go through a sheet."""
    turning = np.stack([-base_xyz[:, 1], base_xyz[:, 0], np.zeros(len(base_xyz))], axis=1)
    return np.asarray(turning @ cell.turntable.camera_from_base[:3, :3].T @ laser.normal)


def error_directions(found: Measured, cell: Cell) -> Floats:
    """Return (n, 3) unit vectors in ``turntable``, along which a stripe's noise moves points."""
    laser = cell.lasers[found.view.laser]
    ways = sensitivity(cell, laser, found.rays) @ cell.turntable.camera_from_base[:3, :3]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return turned_back(ways, found.angles)


def slopes(found: Measured, unknowns: CellUnknowns) -> Floats:
    """Return (n, C, 3) by how many metres points move per unknown of the cell."""
    laser, way = found.view.laser, found.way
    columns = np.zeros((len(found.rays), len(unknowns.names), 3))
    for probe in unknowns.probes:
        if probe.laser in (None, laser):
            ahead, behind = (
                turned_back(seen_from_base(found.rays, cell, laser), found.angles)
                for cell in (probe.ahead, probe.behind)
            )
            columns[:, probe.index] = (ahead - behind) / (2.0 * probe.step)
    x, y, _ = turned_back(seen_from_base(found.rays, unknowns.cell, laser), found.angles).T
    turning = np.stack([y, -x, np.zeros_like(x)], axis=1)
    basis = unknowns.angle_basis(found.angles, way)
    columns[:, unknowns.angle_columns] = basis[:, :, None] * turning[:, None]
    return columns


def refined_view(found: Measured, unknowns: CellUnknowns, values: Floats) -> View:
    """Return the view as the changed cell sees it: other points, angles and sigmas."""
    view, cell = found.view, unknowns.corrected(values)
    points = np.full_like(view.points_xyz, np.nan)
    points[view.valid] = found.points(unknowns, values, cell)
    error = unknowns.angle_error(values, view.angles, found.way)
    return replace(view, points_xyz=points, angles=view.angles + error)


def seen_from_base(rays: Floats, cell: Cell, laser: int) -> Floats:
    """Return (n, 3) where rays meet a sheet, metres in ``turntable_base``."""
    seen = cell.lasers[laser].intersect(rays)
    return transforms.apply(transforms.invert(cell.turntable.camera_from_base), seen)


def turned_back(base_xyz: Floats, angles: Floats) -> Floats:
    """Return (n, 3) points of ``turntable_base`` in ``turntable`` at (n,) radians."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, z = base_xyz.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


def _way(view: View) -> float:
    """Return the sense in which a sweep ran: seqs count up in time, columns in angle."""
    steps = np.diff(view.seqs)
    return -1.0 if len(steps) and np.median(steps) < 0 else 1.0
