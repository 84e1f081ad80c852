# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration of a cell: camera, laser planes and turntable axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from typing import Any

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import parameter_names
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats

# Radians: 36 profiles a turn, below which no surface is meshed well.
_MAX_TRIGGER_STEP = 0.175


@dataclass(frozen=True, eq=False, kw_only=True)
class Turntable:
    """
    Pose of the turntable in the camera frame.

    camera_from_base : (4, 4) rigid, meters; from ``turntable_base`` (origin where the axis meets
        the platter, z up along the axis, x towards the camera) to ``camera_optical_frame``
    joint : name in joint_states
    residual_rms : meters, of the calibration
    covariance : (6, 6) of (translation, rotation vector) in ``camera_optical_frame``, or None
    trigger_step : radians of travel after which the table triggers the camera again, in continuous
        motion; 0 for a camera that it does not trigger
    :raises CellError: the matrix is no rigid transform, the table is behind the camera, or the
        trigger step is out of range
    """

    camera_from_base: Floats
    joint: str = 'turntable_joint'
    residual_rms: float = 0.0
    covariance: Floats | None = None
    trigger_step: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.trigger_step <= _MAX_TRIGGER_STEP:
            raise CellError(
                f'trigger_step: {self.trigger_step} rad must be 0 (not triggered) to '
                f'{_MAX_TRIGGER_STEP}'
            )
        T = self.camera_from_base
        if T.shape != (4, 4) or np.abs(T[3] - (0, 0, 0, 1)).max() > 0:
            raise CellError('camera_from_base: the last row must be 0, 0, 0, 1')
        if not transforms.is_rotation(T[:3, :3]):
            raise CellError(
                'camera_from_base: the 3x3 part is no rotation (not orthonormal, or reflected)'
            )
        if not np.isfinite(T).all():
            raise CellError('camera_from_base: 16 finite numbers are needed')
        if T[2, 3] <= 0:
            raise CellError('camera_from_base: the table stands behind the camera')

    def to_part(self, points_xyz: Floats, angle: float) -> Floats:
        """
        Transform points from ``camera_optical_frame`` to ``turntable``.

        points_xyz : (n, 3) meters
        angle : table position in radians at the exposure
        returns : (n, 3) meters
        """
        base = transforms.apply(transforms.invert(self.camera_from_base), points_xyz)
        return np.asarray(base @ transforms.rotation_z(-angle).T)

    def to_camera(self, points_xyz: Floats, angle: float) -> Floats:
        """Transform (n, 3) points from ``turntable`` at ``angle`` to ``camera_optical_frame``."""
        base = points_xyz @ transforms.rotation_z(angle).T
        return transforms.apply(self.camera_from_base, base)


@dataclass(frozen=True, eq=False, kw_only=True)
class Cell:
    """
    A calibrated cell.

    lasers : in the order to which ``Frame.laser`` and ``Profile.laser`` refer
    notes : of the calibration: board (which gave the scale), temperature_c, exposure, focus
    covariance : of all parameters together, from a joint calibration; None if there was none
    :raises CellError: no laser, two of one name, a plane that the camera cannot see, or a
        covariance of other parameters
    """

    camera: Camera
    turntable: Turntable
    lasers: tuple[LaserPlane, ...]
    camera_frame: str = 'camera_optical_frame'
    notes: Mapping[str, Any] = field(default_factory=dict)
    covariance: CellCovariance | None = None

    def __post_init__(self) -> None:
        if not self.lasers:
            raise CellError('lasers: at least one is needed')
        names = [laser.name for laser in self.lasers]
        if len(set(names)) != len(names):
            raise CellError(f'lasers: two have the same name ({", ".join(names)})')
        for laser in self.lasers:
            if not is_visible(self.camera, laser):
                raise CellError(f'lasers: {laser.name}: plane: the camera cannot see it')
        expected = parameter_names(self.camera, names)
        if self.covariance is not None and self.covariance.parameters != expected:
            raise CellError(
                'covariance: parameters: must be those of camera, lasers and axis, in this order: '
                + ', '.join(expected)
            )


def is_visible(camera: Camera, laser: LaserPlane, max_depth: float = 20.0) -> bool:
    """Return whether the camera sees the laser plane within ``max_depth`` meters."""
    columns, rows = np.meshgrid(
        np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 25)
    )
    points = laser.intersect(camera.rays(np.stack([columns.ravel(), rows.ravel()], axis=1)))
    with np.errstate(invalid='ignore'):
        return bool((points[:, 2] < max_depth).any())
