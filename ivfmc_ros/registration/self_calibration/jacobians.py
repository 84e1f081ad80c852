# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Points of a view, and their derivatives, as functions of pixel, table angle and cell.

The points for a changed cell follow exactly from the rays of the pixels and the table angles.
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
from ivfmc_ros.registration.self_calibration.parameters import CellParameters
from ivfmc_ros.stripe.triangulate import sensitivity

# Newton steps to the table angle of a point, and the largest step, radians: near the axis a point
# stays in the plane at any angle.
_NEWTON_STEPS, _MAX_ANGLE_STEP = 3, 0.1
# A view's points may differ by this from those computed from its pixels, meters (rounding).
_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredView:
    """
    The measurements of a view's n valid points.

    rays : (n, 3) of unit depth, ``camera_optical_frame``
    angles : (n,) radians, table angles as reported
    direction : 1 if the table turned to rising angles, -1 to falling
    """

    view: View
    rays: Floats
    angles: Floats
    direction: float

    def per_point(self, angles: Floats) -> Floats:
        """Return (n,) angles of the valid points from (columns,) angles of the profiles."""
        valid = self.view.valid
        return np.asarray(np.broadcast_to(angles, valid.shape)[valid])

    def points(self, parameters: CellParameters, values: Floats, cell: Cell) -> Floats:
        """
        Return (n, 3) meters, frame ``turntable``.

        values : (C,) of the parameters
        cell : the one that has these values
        """
        error = parameters.angle_error(values, self.angles, self.direction)
        angles = self.angles + error
        return table_from_base(intersect_plane(self.rays, cell, self.view.laser), angles)


def measured_view(cell: Cell, view: View) -> MeasuredView:
    """
    Return the measurements of a view.

    :raises GeometryError: its points are not those that ``cell`` gives for its pixels
    """
    valid = view.valid
    measured = MeasuredView(
        view=view,
        rays=cell.camera.rays(view.uv[valid]),
        angles=np.broadcast_to(view.angles, valid.shape)[valid],
        direction=_direction(view),
    )
    base = intersect_plane(measured.rays, cell, view.laser)
    difference = np.abs(table_from_base(base, measured.angles) - view.points_xyz[valid])
    if difference.size and not difference.max() < _TOLERANCE:
        raise GeometryError(
            f'view {view.number}: its points do not follow from its pixels and the cell; '
            'refine with the cell that the scan was reconstructed with'
        )
    return measured


def measurements_at(
    measured: MeasuredView, cell: Cell, points_xyz: Floats, angles: Floats
) -> MeasuredView:
    """
    Return the rays and table angles at which a view would measure (n, 3) points of the surface.

    The Jacobian of a measured point nearby cannot be used instead: its table angle differs, and
    the information of two sweeps about the angle is in the difference of their angles.

    angles : (n,) radians, of measured points nearby
    """
    laser, T = cell.lasers[measured.view.laser], cell.turntable.camera_from_base
    for _ in range(_NEWTON_STEPS):
        base = table_from_base(points_xyz, -angles)
        camera = transforms.apply(T, base)
        speed = plane_crossing_speed(cell, laser, base)
        step = np.divide(laser.distance(camera), speed, out=np.zeros(len(speed)), where=speed != 0)
        # near the axis the point is in the plane at any angle
        angles = angles - np.where(np.abs(step) < _MAX_ANGLE_STEP, step, 0.0)
    camera = transforms.apply(T, table_from_base(points_xyz, -angles))
    return replace(measured, rays=camera / camera[:, 2:], angles=angles)


def plane_crossing_speed(cell: Cell, laser: LaserPlane, base_xyz: Floats) -> Floats:
    """Return (n,) meters per radian at which turning points move through the laser plane."""
    tangent = np.stack([-base_xyz[:, 1], base_xyz[:, 0], np.zeros(len(base_xyz))], axis=1)
    return np.asarray(tangent @ cell.turntable.camera_from_base[:3, :3].T @ laser.normal)


def noise_directions(measured: MeasuredView, cell: Cell) -> Floats:
    """Return (n, 3) unit vectors in ``turntable`` along which a stripe's noise moves points."""
    laser = cell.lasers[measured.view.laser]
    directions = sensitivity(cell, laser, measured.rays) @ cell.turntable.camera_from_base[:3, :3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return table_from_base(directions, measured.angles)


def cell_jacobian(measured: MeasuredView, parameters: CellParameters) -> Floats:
    """
    Return (n, C, 3), the derivative of the points by the cell's parameters.

    Axis and planes: central differences. Table angle: analytic.
    """
    laser = measured.view.laser
    columns = np.zeros((len(measured.rays), len(parameters.names), 3))
    for step in parameters.finite_differences:
        if step.laser in (None, laser):
            ahead, behind = (
                table_from_base(intersect_plane(measured.rays, cell, laser), measured.angles)
                for cell in (step.ahead, step.behind)
            )
            columns[:, step.index] = (ahead - behind) / (2.0 * step.step)
    base = intersect_plane(measured.rays, parameters.cell, laser)
    x, y, _ = table_from_base(base, measured.angles).T
    tangent = np.stack([y, -x, np.zeros_like(x)], axis=1)
    basis = parameters.angle_basis(measured.angles, measured.direction)
    columns[:, parameters.angle_columns] = basis[:, :, None] * tangent[:, None]
    return columns


def corrected_view(measured: MeasuredView, parameters: CellParameters, values: Floats) -> View:
    """Return the view for (C,) values of the cell's parameters: new points and angles."""
    view, cell = measured.view, parameters.corrected(values)
    points = np.full_like(view.points_xyz, np.nan)
    points[view.valid] = measured.points(parameters, values, cell)
    error = parameters.angle_error(values, view.angles, measured.direction)
    return replace(view, points_xyz=points, angles=view.angles + error)


def intersect_plane(rays: Floats, cell: Cell, laser: int) -> Floats:
    """Return (n, 3) intersections of rays with a laser plane, meters in ``turntable_base``."""
    camera = cell.lasers[laser].intersect(rays)
    return transforms.apply(transforms.invert(cell.turntable.camera_from_base), camera)


def table_from_base(base_xyz: Floats, angles: Floats) -> Floats:
    """Return (n, 3) points of ``turntable_base`` in ``turntable`` at (n,) radians."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, z = base_xyz.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


def _direction(view: View) -> float:
    """Return the direction of a sweep: seqs increase with time, columns with the angle."""
    steps = np.diff(view.seqs)
    return -1.0 if len(steps) and np.median(steps) < 0 else 1.0
