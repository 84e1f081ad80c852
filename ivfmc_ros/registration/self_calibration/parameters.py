# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of a cell can be wrong by a little: the axis, the table's angle, the laser planes."""

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


# Share of its prior's sigma by which an unknown is changed for a derivative.
_PROBE = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Probe:
    """
    The cell with one unknown changed by ``step`` ahead and behind.

    index : of the unknown; laser : the only one whose points move by it, None for all
    """

    index: int
    laser: int | None
    step: float
    ahead: Cell
    behind: Cell


@dataclass(frozen=True, eq=False, kw_only=True)
class CellUnknowns:
    """
    The unknowns of a cell, in a fixed order, and what a value of them makes of it.

    groups : of ``REFINABLE``, which are unknown; height : metres above the platter of the point
        of the axis about which axis and planes turn
    """

    cell: Cell
    groups: frozenset[str]
    height: float
    prior: CellPrior

    @property
    def names(self) -> list[str]:
        """What is unknown: radians for angles, tilts, yaws and rolls, metres for the others."""
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
        """(C,) the prior's sigma of each unknown, in its unit."""
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
        """Return the cell with (C,) values of the unknowns."""
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

    def angle_error(self, values: Floats, angles: Floats, way: float) -> Floats:
        """
        Return (n,) radians by which the table is ahead of what it reports.

        angles : (n,) radians as reported; way : 1 for a sweep of rising angles, -1 for falling
        """
        return np.asarray(self.angle_basis(angles, way) @ values[self.angle_columns])

    @property
    def angle_columns(self) -> slice:
        """Which of the unknowns are of the table's angle."""
        if 'angle' not in self.groups:
            return slice(0, 0)
        first = len(_AXIS) if 'axis' in self.groups else 0
        return slice(first, first + 2 * self.prior.orders + 1)

    def angle_basis(self, angles: Floats, way: float) -> Floats:
        """Return (n, A) by how many radians the table is ahead per unknown of its angle."""
        if 'angle' not in self.groups:
            return np.zeros((len(angles), 0))
        turn = np.outer(angles, np.arange(1, self.prior.orders + 1))
        basis = np.empty((len(angles), 2 * self.prior.orders + 1))
        basis[:, 0:-1:2], basis[:, 1:-1:2], basis[:, -1] = np.cos(turn), np.sin(turn), 0.5 * way
        return basis

    @cached_property
    def probes(self) -> list[Probe]:
        """What is changed for the derivatives by axis and planes; of allowed changes only."""
        probes = []
        lasers = {
            f'{laser.name} {part}': k
            for k, laser in enumerate(self.cell.lasers)
            for part in _PLANE
        }
        angle = range(*self.angle_columns.indices(len(self.names)))
        for index, (name, step) in enumerate(zip(self.names, _PROBE * self.sigma, strict=True)):
            if index in angle or step == 0.0:
                continue
            change = np.zeros(len(self.names))
            change[index] = step
            probes.append(
                Probe(
                    index=index,
                    laser=lasers.get(name),
                    step=float(step),
                    ahead=self.corrected(change),
                    behind=self.corrected(-change),
                )
            )
        return probes

    def _plane(self, laser: LaserPlane, yaw: float, roll: float, offset: float) -> LaserPlane:
        """Turn a plane about the point of it nearest to the middle of the volume."""
        centre, upright, across = self.frame_of(laser)
        turn = Rotation.from_rotvec(yaw * upright + roll * across)
        normal = turn.apply(laser.normal)
        bow = laser.bow
        if bow is not None:
            moved = centre + turn.apply(bow.center - centre) - offset * normal
            bow = replace(bow, center=moved, along=turn.apply(bow.along))
        return replace(laser, normal=normal, offset=float(offset - normal @ centre), bow=bow)

    def frame_of(self, laser: LaserPlane) -> tuple[Floats, Floats, Floats]:
        """Return the centre of a plane (metres), and the axes of its yaw and of its roll."""
        base = self.cell.turntable.camera_from_base
        middle = base[:3, :3] @ (0.0, 0.0, self.height) + base[:3, 3]
        centre = middle - laser.normal * (laser.normal @ middle + laser.offset)
        upright = base[:3, 2] - laser.normal * (laser.normal @ base[:3, 2])
        if np.linalg.norm(upright) < 0.1:  # a level sheet: any direction in it
            upright = base[:3, 0] - laser.normal * (laser.normal @ base[:3, 0])
        upright = upright / np.linalg.norm(upright)
        return centre, upright, np.cross(laser.normal, upright)


def require_groups(groups: Collection[str]) -> frozenset[str]:
    """
    Return the groups as a set.

    :raises ParameterError: one is not known
    """
    for group in groups:
        require_one_of('refine', group, REFINABLE)
    return frozenset(groups)
