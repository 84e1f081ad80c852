# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid motions in words."""

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.model import Floats

# A turn of less is none; a shift along the axis of less is none.
_LEAST_TURN, _LEAST_SHIFT = np.radians(0.5), 2e-4


def motion_in_words(T: Floats) -> str:
    """Say what a rigid (4, 4) motion does: a turn and a shift along its axis, or a shift."""
    turn = Rotation.from_matrix(T[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(turn))
    if angle < _LEAST_TURN:
        return f'a shift by {_vector(T[:3, 3] * 1e3, 2)} mm'
    axis = turn / angle
    upward = _upward(axis)
    axis = upward * axis
    # half a turn is the same either way
    degrees = np.degrees(angle) * (upward if angle < np.pi - 1e-3 else 1.0)
    along = float(axis @ T[:3, 3])
    words = f'a turn by {degrees:.1f} degrees about {_line(axis, _point(T, axis, along))}'
    return words if abs(along) < _LEAST_SHIFT else f'{words} and a shift of {along * 1e3:.2f} mm'


def free_motion_in_words(twist: Floats) -> str:
    """Say which motions a (6,) direction (rotation vector, translation) stands for."""
    turn, shift = twist[:3], twist[3:]
    rate = float(np.linalg.norm(turn))
    # in metres at the size of what stands on a table
    if rate * 0.02 < 0.1 * np.linalg.norm(shift):
        return f'any shift along {_vector(shift / np.linalg.norm(shift), 2)}'
    axis = turn / rate * _upward(turn)
    return f'any turn about {_line(axis, np.cross(turn, shift) / rate**2)}'


def _point(T: Floats, axis: Floats, along: float) -> Floats:
    """Return the point of the axis of a turn that is nearest to the origin."""
    across = T[:3, 3] - along * axis
    A = np.vstack([np.eye(3) - T[:3, :3], axis])
    return np.asarray(np.linalg.lstsq(A, np.append(across, 0.0), rcond=None)[0])


def _upward(axis: Floats) -> float:
    """Return the sign that makes the largest component of an axis positive."""
    return float(np.sign(axis[np.argmax(np.abs(axis))]) or 1.0)


def _line(axis: Floats, point: Floats) -> str:
    return f'the axis {_vector(axis, 2)} through {_vector(point * 1e3, 1)} mm'


def _vector(values: Floats, digits: int) -> str:
    # no minus before a zero
    rounded = np.round(values, digits) + 0.0
    return '(' + ', '.join(f'{value:.{digits}f}' for value in rounded) + ')'
