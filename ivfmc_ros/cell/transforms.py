# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms as 4x4 matrices; ``target_from_source`` maps points of source to target."""

import numpy as np
from numpy.typing import ArrayLike

from ivfmc_ros.model import Floats


def rotation_z(angle: ArrayLike) -> Floats:
    """
    Return the rotation about +z, counter-clockwise.

    angle : scalar or (n,) radians
    returns : (3, 3) or (n, 3, 3) float64
    """
    angle = np.asarray(angle, dtype=np.float64)
    R = np.zeros((*angle.shape, 3, 3))
    R[..., 0, 0] = R[..., 1, 1] = np.cos(angle)
    R[..., 1, 0] = np.sin(angle)
    R[..., 0, 1] = -R[..., 1, 0]
    R[..., 2, 2] = 1.0
    return R


def rigid(rotation: Floats, translation: ArrayLike) -> Floats:
    """Return the (4, 4) matrix of a (3, 3) rotation and a (3,) translation in meters."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = np.asarray(translation)
    return T


def invert(T: Floats) -> Floats:
    """Return the inverse of a rigid (4, 4) matrix."""
    R = T[:3, :3].T
    return rigid(R, -R @ T[:3, 3])


def apply(T: Floats, points_xyz: Floats) -> Floats:
    """Return (..., 3) points transformed by a rigid (4, 4) matrix."""
    return np.asarray(points_xyz @ T[:3, :3].T + T[:3, 3])


def is_rotation(R: Floats, tolerance: float = 1e-5) -> bool:
    """Return whether a (3, 3) matrix is orthonormal and not a reflection."""
    orthonormal = np.abs(R @ R.T - np.eye(3)).max() <= tolerance
    return bool(orthonormal and np.linalg.det(R) > 0)
