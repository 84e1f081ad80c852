# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Description of rigid motions in words, for messages."""

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.model import Floats

# A smaller rotation (radians) is described as a shift only; a smaller shift along the axis
# (meters) is not mentioned. Both are below the accuracy of a pose search.
_MIN_ROTATION, _MIN_SHIFT = np.radians(0.5), 2e-4
# meters, size of a small part, at which rotations and shifts are compared
_PART_SIZE = 0.02


def describe_motion(T: Floats) -> str:
    """Describe a rigid (4, 4) motion as a turn and a shift along its axis, or as a shift."""
    rotation = Rotation.from_matrix(T[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(rotation))
    if angle < _MIN_ROTATION:
        return f'a shift by {_vector(T[:3, 3] * 1e3, 2)} mm'
    axis = rotation / angle
    sign = _sign(axis)
    axis = sign * axis
    # half a turn is the same in both directions
    degrees = np.degrees(angle) * (sign if angle < np.pi - 1e-3 else 1.0)
    along = float(axis @ T[:3, 3])
    text = f'a turn by {degrees:.1f} degrees about {_line(axis, _axis_point(T, axis, along))}'
    return text if abs(along) < _MIN_SHIFT else f'{text} and a shift of {along * 1e3:.2f} mm'


def describe_free_motion(motion: Floats) -> str:
    """Describe the one-parameter family of motions along a (6,) rotation vector, translation."""
    rotation, translation = motion[:3], motion[3:]
    rate = float(np.linalg.norm(rotation))
    if rate * _PART_SIZE < 0.1 * np.linalg.norm(translation):
        return f'any shift along {_vector(translation / np.linalg.norm(translation), 2)}'
    axis = rotation / rate * _sign(rotation)
    return f'any turn about {_line(axis, np.cross(rotation, translation) / rate**2)}'


def _axis_point(T: Floats, axis: Floats, along: float) -> Floats:
    """Return the point of the rotation axis that is nearest to the origin."""
    across = T[:3, 3] - along * axis
    A = np.vstack([np.eye(3) - T[:3, :3], axis])
    return np.asarray(np.linalg.lstsq(A, np.append(across, 0.0), rcond=None)[0])


def _sign(axis: Floats) -> float:
    """Return the sign that makes the largest component of an axis positive."""
    return float(np.sign(axis[np.argmax(np.abs(axis))]) or 1.0)


def _line(axis: Floats, point: Floats) -> str:
    return f'the axis {_vector(axis, 2)} through {_vector(point * 1e3, 1)} mm'


def _vector(values: Floats, digits: int) -> str:
    # + 0.0 removes the minus of a negative zero
    rounded = np.round(values, digits) + 0.0
    return '(' + ', '.join(f'{value:.{digits}f}' for value in rounded) + ')'
