# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Independent errors of a cell, from the joint covariance of its calibration."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import INTRINSIC_NAMES
from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats

CAMERA, LASERS, AXIS = 'camera', 'laser planes', 'table axis'
# Smallest variance of a direction, as a fraction of the greatest, in units of each sigma.
_LEAST_VARIANCE = 1e-9


def independent_deviations(covariance: CellCovariance) -> Iterator[tuple[str, Floats]]:
    """
    Yield independent errors of one standard deviation: their squares add up (block Cholesky).

    An error of the camera comes with the errors of planes and axis that it causes; then follow
    those of the planes for a known camera, and those of the axis for known camera and planes.

    returns : source (camera, laser planes or table axis) and (p,) deviation of all parameters
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance.matrix), 0.0))
    unit = np.where(sigma > 0, sigma, 1.0)
    left = covariance.matrix / np.outer(unit, unit)
    sources = np.array([_source(name) for name in covariance.parameters])
    for source in (CAMERA, LASERS, AXIS):
        own = np.flatnonzero(sources == source)
        values, vectors = np.linalg.eigh(left[np.ix_(own, own)])
        for value, vector in zip(values, vectors.T, strict=True):
            if value > _LEAST_VARIANCE:
                deviation = left[:, own] @ vector / np.sqrt(value)
                left = left - np.outer(deviation, deviation)
                yield source, unit * deviation


def _source(name: str) -> str:
    if name in INTRINSIC_NAMES:
        return CAMERA
    return AXIS if name.startswith('axis.') else LASERS


def deviated(cell: Cell, deviation: Floats) -> Cell:
    """
    Return the cell with its parameters changed.

    deviation : (p,) in the order of ``parameter_names``
    :raises CellError: no cell has such parameters
    """
    count = 4 + len(cell.camera.distortion)
    camera = cell.camera
    if deviation[:count].any():
        fx, fy, cx, cy = deviation[:4]
        K = camera.K + np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 0.0]])
        camera = replace(camera, K=K, distortion=camera.distortion + deviation[4:count])
    lasers = tuple(
        _deviated_laser(laser, deviation[count + 4 * index : count + 4 * index + 4])
        for index, laser in enumerate(cell.lasers)
    )
    T = cell.turntable.camera_from_base
    turn = np.asarray(cv2.Rodrigues(deviation[-3:])[0], dtype=np.float64)
    moved = transforms.rigid(turn @ T[:3, :3], T[:3, 3] + deviation[-6:-3])
    turntable = replace(cell.turntable, camera_from_base=moved)
    return replace(cell, camera=camera, lasers=lasers, turntable=turntable)


def _deviated_laser(laser: LaserPlane, deviation: Floats) -> LaserPlane:
    normal = laser.normal + deviation[:3]
    length = float(np.linalg.norm(normal))
    normal, offset = normal / length, (laser.offset + float(deviation[3])) / length
    bow = laser.bow
    if bow is not None:
        along = bow.along - (bow.along @ normal) * normal
        bow = Bow(
            center=bow.center - (bow.center @ normal + offset) * normal,
            along=along / np.linalg.norm(along),
            coefficients=bow.coefficients,
        )
    return replace(laser, normal=normal, offset=offset, bow=bow)
