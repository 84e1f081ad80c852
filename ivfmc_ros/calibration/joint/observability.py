# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the pictures of a joint calibration do not determine, by name.

Each principal direction of the covariance moves the points of the working volume. Directions that
move them by more than a limit are not determined well enough; those parameters are named that
carry them.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.joint.adjustment import JointAdjustment
from ivfmc_ros.calibration.joint.cell_covariance import cell_covariance
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import point_jacobian
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.model import Floats

# Displacement in meters, 1 sigma, of a point of the volume from which a direction is reported: a
# fifth of the error that a good cell of this size has (0.05 mm).
_MAX_DISPLACEMENT = 5e-5
_MAX_NAMES = 3  # parameters named for one direction
_GRID = (7, 5)  # points of a laser plane in the volume: along the radius, along the height


@dataclass(frozen=True, kw_only=True)
class WeakDirection:
    """
    A combination of parameters that the pictures hardly determine.

    displacement : meters, greatest in the volume for 1 sigma
    parameters : names of those that carry it, the strongest first
    """

    displacement: float
    parameters: tuple[str, ...]

    def __str__(self) -> str:
        return (
            f'{", ".join(self.parameters)}: determined together only within '
            f'{self.displacement * 1e3:.2f} mm (1 sigma, worst point of the volume)'
        )


def weak_directions(
    adjusted: JointAdjustment, volume: Volume | None = None
) -> tuple[WeakDirection, ...]:
    """Return the combinations of parameters that the pictures hardly determine."""
    covariance = cell_covariance(adjusted)
    moves = volume_displacements(adjusted, covariance, volume or Volume())
    sigma = np.sqrt(np.diag(covariance.matrix))
    found = []
    for deviation, displacement in zip(covariance.deviations(), moves, strict=True):
        if displacement <= _MAX_DISPLACEMENT:
            continue
        share = np.abs(deviation) / np.where(sigma > 0, sigma, np.inf)
        strongest = np.argsort(-share)[:_MAX_NAMES]
        names = tuple(covariance.parameters[int(index)] for index in strongest)
        found.append(WeakDirection(displacement=float(displacement), parameters=names))
    return tuple(sorted(found, key=lambda one: -one.displacement))


def volume_displacements(
    adjusted: JointAdjustment, covariance: CellCovariance, volume: Volume
) -> Floats:
    """Return (k,) meters: greatest displacement in the volume by each deviation of 1 sigma."""
    jacobians = volume_jacobians(adjusted, covariance.parameters, volume)
    moves = np.einsum('nxp,kp->knx', jacobians, covariance.deviations())
    return np.asarray(np.linalg.norm(moves, axis=2).max(axis=1))


def worst_point_sigma(
    adjusted: JointAdjustment, covariance: CellCovariance, volume: Volume
) -> float:
    """Return the greatest standard deviation in meters of a point of the volume (all axes)."""
    jacobians = volume_jacobians(adjusted, covariance.parameters, volume)
    variance = np.einsum('nxp,pq,nxq->n', jacobians, covariance.matrix, jacobians)
    return float(np.sqrt(variance.max()))


def volume_jacobians(
    adjusted: JointAdjustment, parameters: tuple[str, ...], volume: Volume
) -> Floats:
    """Return (n, 3, p): derivative of points of all laser planes in the volume."""
    state, rows = adjusted.state, []
    T = state.axis.camera_from_base
    for laser in state.lasers:
        points = laser_plane_grid(T, laser.normal, laser.offset, volume)
        uv = state.camera.project(points)
        found = point_jacobian(state.camera, (laser.normal, laser.offset), T, uv, 0.0)
        full = np.zeros((len(points), 3, len(parameters)))
        intrinsics = found.shape[2] - 10
        plane = [parameters.index(f'{laser.name}.{part}') for part in ('nx', 'ny', 'nz', 'd')]
        full[:, :, :intrinsics] = found[:, :, :intrinsics]
        full[:, :, plane] = found[:, :, intrinsics : intrinsics + 4]
        full[:, :, -6:] = found[:, :, -6:]
        rows.append(full)
    return np.concatenate(rows)


def laser_plane_grid(
    camera_from_base: Floats, normal: Floats, offset: float, volume: Volume
) -> Floats:
    """Return (n, 3) meters: points of a laser plane in the volume, camera_optical_frame."""
    radius = np.linspace(-volume.radius, volume.radius, _GRID[0])
    height = np.linspace(volume.bottom, volume.top, _GRID[1])
    base_normal = camera_from_base[:3, :3].T @ normal
    level = np.hypot(base_normal[0], base_normal[1])
    if level < 1e-6:
        return np.empty((0, 3))
    along = np.array([-base_normal[1], base_normal[0]]) / level
    distance = offset + normal @ camera_from_base[:3, 3]
    points = []
    for z in height:
        foot = -(distance + base_normal[2] * z) / level**2 * base_normal[:2]
        xy = foot + radius[:, None] * along
        points.append(np.column_stack([xy, np.full(len(xy), z)]))
    base = np.concatenate(points)
    inside = np.hypot(base[:, 0], base[:, 1]) <= volume.radius * (1 + 1e-9)
    return transforms.apply(camera_from_base, base[inside])
