# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the self-calibration: axis, periodic table-angle error, laser planes."""

from collections.abc import Collection
from dataclasses import dataclass
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.solver.prior import CellPrior
from ivfmc_ros.validation import require_one_of

REFINABLE = ('poses', 'axis', 'angle', 'lasers')

_AXIS = ('axis x', 'axis y', 'axis tilt x', 'axis tilt y')
_PLANE = ('yaw', 'roll', 'offset')

# Step of a central difference, as a share of the parameter's prior standard deviation.
_STEP = 0.5
# A laser plane whose normal is closer to the axis than this (sine of the angle) is level: the
# axis has no direction in it from which yaw and roll could be measured.
_MIN_UPRIGHT = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class FiniteDifference:
    """
    Two cells for the central difference by one parameter.

    index : of the parameter
    laser : index of the only laser whose points depend on it; None for all
    step : change of the parameter in ``ahead`` (``behind``: -step), radians or meters
    """

    index: int
    laser: int | None
    step: float
    ahead: Cell
    behind: Cell


@dataclass(frozen=True, eq=False, kw_only=True)
class CellParameters:
    """
    The C parameters of a cell that are estimated, in a fixed order; 0 is the given cell.

    groups : which are estimated, of ``REFINABLE``
    height : meters above the platter of the point of the axis about which axis and planes rotate
    """

    cell: Cell
    groups: frozenset[str]
    height: float
    prior: CellPrior

    @property
    def names(self) -> list[str]:
        """Names of the parameters. Angles, tilts, yaws, rolls: radians; the others: meters."""
        names: list[str] = []
        if 'axis' in self.groups:
            names += _AXIS
        if 'angle' in self.groups:
            orders = range(1, self.prior.orders + 1)
            names += [f'angle {kind} {order}' for order in orders for kind in ('cos', 'sin')]
            names.append('backlash')
        if 'lasers' in self.groups:
            names += [f'{laser.name} {part}' for laser in self.cell.lasers for part in _PLANE]
        return names

    @property
    def sigma(self) -> Floats:
        """(C,) prior standard deviation of each parameter, in its unit."""
        prior = self.prior
        tilt, offset = prior.axis_tilt, prior.axis_offset
        sigma: list[float] = []
        if 'axis' in self.groups:
            sigma += [offset, offset, tilt, tilt]
        if 'angle' in self.groups:
            each = prior.angle / np.sqrt(prior.orders)
            sigma += [each] * (2 * prior.orders) + [prior.backlash]
        if 'lasers' in self.groups:
            sigma += [prior.laser_tilt, prior.laser_tilt, prior.laser_offset] * len(
                self.cell.lasers
            )
        return np.array(sigma)

    def corrected(self, values: Floats) -> Cell:
        """Return the cell for (C,) values of the parameters."""
        known = dict(zip(self.names, values, strict=True))
        cell = self.cell
        if 'axis' in self.groups:
            turn = Rotation.from_rotvec([known['axis tilt x'], known['axis tilt y'], 0.0])
            middle = np.array([0.0, 0.0, self.height])
            R = turn.as_matrix()
            shift = np.array([known['axis x'], known['axis y'], 0.0])
            pose = cell.turntable.camera_from_base @ transforms.rigid(
                R, middle - R @ middle + shift
            )
            cell = replace(cell, turntable=replace(cell.turntable, camera_from_base=pose))
        if 'lasers' in self.groups:
            lasers = tuple(
                self._plane(laser, *(known[f'{laser.name} {part}'] for part in _PLANE))
                for laser in cell.lasers
            )
            cell = replace(cell, lasers=lasers)
        return cell

    def angle_error(self, values: Floats, angles: Floats, direction: float) -> Floats:
        """
        Return (n,) radians, true minus reported table angle.

        angles : (n,) radians as reported
        direction : 1 for a sweep of rising angles, -1 for falling
        """
        return np.asarray(self.angle_basis(angles, direction) @ values[self.angle_columns])

    @property
    def angle_columns(self) -> slice:
        """The parameters of the table's angle."""
        if 'angle' not in self.groups:
            return slice(0, 0)
        first = len(_AXIS) if 'axis' in self.groups else 0
        return slice(first, first + 2 * self.prior.orders + 1)

    def angle_basis(self, angles: Floats, direction: float) -> Floats:
        """Return (n, A), the derivative of the angle error by the parameters of the angle."""
        if 'angle' not in self.groups:
            return np.zeros((len(angles), 0))
        phase = np.outer(angles, np.arange(1, self.prior.orders + 1))
        basis = np.empty((len(angles), 2 * self.prior.orders + 1))
        basis[:, 0:-1:2], basis[:, 1:-1:2] = np.cos(phase), np.sin(phase)
        basis[:, -1] = 0.5 * direction
        return basis

    @cached_property
    def finite_differences(self) -> list[FiniteDifference]:
        """The central differences by axis and planes, without parameters that the prior fixes."""
        lasers = {
            f'{laser.name} {part}': k
            for k, laser in enumerate(self.cell.lasers)
            for part in _PLANE
        }
        angle = range(*self.angle_columns.indices(len(self.names)))
        steps = []
        for index, (name, step) in enumerate(zip(self.names, _STEP * self.sigma, strict=True)):
            if index in angle or step == 0.0:
                continue
            change = np.zeros(len(self.names))
            change[index] = step
            steps.append(
                FiniteDifference(
                    index=index,
                    laser=lasers.get(name),
                    step=float(step),
                    ahead=self.corrected(change),
                    behind=self.corrected(-change),
                )
            )
        return steps

    def _plane(self, laser: LaserPlane, yaw: float, roll: float, offset: float) -> LaserPlane:
        """Rotate a plane about its point nearest to the middle of the volume, and shift it."""
        center, upright, across = self.plane_axes(laser)
        turn = Rotation.from_rotvec(yaw * upright + roll * across)
        normal = turn.apply(laser.normal)
        bow = laser.bow
        if bow is not None:
            moved = center + turn.apply(bow.center - center) - offset * normal
            bow = replace(bow, center=moved, along=turn.apply(bow.along))
        return replace(laser, normal=normal, offset=float(offset - normal @ center), bow=bow)

    def plane_axes(self, laser: LaserPlane) -> tuple[Floats, Floats, Floats]:
        """Return the center of a plane (meters, camera), and the axes of its yaw and roll."""
        base = self.cell.turntable.camera_from_base
        middle = base[:3, :3] @ (0.0, 0.0, self.height) + base[:3, 3]
        center = middle - laser.normal * (laser.normal @ middle + laser.offset)
        upright = base[:3, 2] - laser.normal * (laser.normal @ base[:3, 2])
        if np.linalg.norm(upright) < _MIN_UPRIGHT:  # level: any direction in the plane will do
            upright = base[:3, 0] - laser.normal * (laser.normal @ base[:3, 0])
        upright = upright / np.linalg.norm(upright)
        return center, upright, np.cross(laser.normal, upright)


def require_groups(groups: Collection[str]) -> frozenset[str]:
    """
    Return the groups as a set.

    :raises ParameterError: a group is not one of ``REFINABLE``
    """
    for group in groups:
        require_one_of('refine', group, REFINABLE)
    return frozenset(groups)
