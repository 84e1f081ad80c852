# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fits planes to the four vertical sides of a block, for its angles and flatness."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Points farther than this from a plane are outliers, millimeters.
_MAX_DISTANCE = 1.0


@dataclass(frozen=True)
class FittedBox:
    """
    Four vertical sides of a block, counter-clockwise.

    corners : (4,) degrees between neighboring sides
    skew : (2,) degrees by which opposite sides are not parallel
    flatness : (4,) rms in millimeters of each side's points about its plane
    inliers : (4,) share of the points facing that way that are within 1 mm of the plane
    """

    corners: Array
    skew: Array
    flatness: Array
    inliers: Array


def fit_box(points: Array, normals: Array, low: float, high: float) -> FittedBox:
    """
    Fit the sides of a block.

    points, normals : (n, 3), millimeters, z up
    low, high : heights between which points are used, millimeters
    """
    upright = (points[:, 2] > low) & (points[:, 2] < high) & (np.abs(normals[:, 2]) < 0.35)
    points, normals = points[upright], normals[upright]
    azimuth = np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    counts, edges = np.histogram(azimuth % 90.0, bins=90)
    first = edges[counts.argmax()] + 0.5
    sides = [_fit_side(points, azimuth, first + 90.0 * k) for k in range(4)]
    planes = np.array([side[0] for side in sides])
    return FittedBox(
        corners=np.array([_angle(planes[k], planes[(k + 1) % 4]) for k in range(4)]),
        skew=np.array([180.0 - _angle(planes[k], planes[k + 2]) for k in range(2)]),
        flatness=np.array([side[1] for side in sides]),
        inliers=np.array([side[2] for side in sides]),
    )


def _fit_side(points: Array, azimuth: Array, towards: float) -> tuple[Array, float, float]:
    facing = np.abs((azimuth - towards + 180.0) % 360.0 - 180.0) < 15.0
    side = points[facing]
    used = side
    for _ in range(10):
        center = used.mean(axis=0)
        normal = np.linalg.svd(used - center, full_matrices=False)[2][2]
        distance = (side - center) @ normal
        used = side[np.abs(distance) < _MAX_DISTANCE]
    outward = np.array([np.cos(np.radians(towards)), np.sin(np.radians(towards)), 0.0])
    near = np.abs(distance) < _MAX_DISTANCE
    flatness = float(np.sqrt(np.mean(distance[near] ** 2)))
    return normal * np.sign(normal @ outward), flatness, float(near.mean())


def _angle(a: Array, b: Array) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))
