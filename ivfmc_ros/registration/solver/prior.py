# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much a table, and the cell around it, may err: the prior of the registration."""

from dataclasses import dataclass
from dataclasses import fields
import math

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

_TURN = 2  # about z, in the order of a pose's unknowns
# Two lasers that are 66 degrees apart see no higher order well.
_MOST_ORDERS = 11


@dataclass(frozen=True, kw_only=True)
class TablePrior:
    """
    1 sigma of where a view belongs against where the table says, in ``turntable``.

    angle : radians about the axis (slip of table or part); tilt : radians about x and y (wobble)
    offset : metres along x and y; height : metres along z
    0 allows nothing.
    """

    angle: float = math.radians(0.2)
    tilt: float = math.radians(0.05)
    offset: float = 2e-4
    height: float = 5e-5

    def __post_init__(self) -> None:
        require_sigmas(self)

    @property
    def sigma(self) -> Floats:
        """(6,) rotation vector in radians, translation in metres."""
        tilt, offset = self.tilt, self.offset
        return np.array([tilt, tilt, self.angle, offset, offset, self.height])


@dataclass(frozen=True, kw_only=True)
class CellPrior:
    """
    1 sigma of what may be wrong with a cell, radians and metres.

    The covariances of the calibration, where the cell has them, come on top.

    axis_offset, axis_tilt : of the axis, across it
    angle : of the table's periodic error at any angle, to which all its orders contribute alike;
        orders : how many there are
    backlash : between sweeps of opposite direction
    laser_tilt, laser_offset : of each plane, about and from the middle of the volume; the offset
        is what a turn by the tilt about a point some 30 mm aside makes
    """

    axis_offset: float = 1e-4
    axis_tilt: float = math.radians(0.05)
    angle: float = math.radians(0.1)
    orders: int = 6
    backlash: float = math.radians(0.05)
    laser_tilt: float = math.radians(0.05)
    laser_offset: float = 2.5e-5

    def __post_init__(self) -> None:
        require_sigmas(self)
        require_in_range('prior: orders', self.orders, 1, _MOST_ORDERS)


def pose_root(prior: TablePrior, held: Bools) -> Floats:
    """
    Return a matrix L, (6 views) squared, with the covariance L L' of the poses of all views.

    A part that was moved stays where it is, and lost steps stay lost: from view to view all is
    a random walk, away from the views that are held. Half of the angle's variance is each
    view's own.

    held : (views,) bool, views that stay where they are
    """
    walk = _walk(held)
    own = np.diag(np.where(held, 0.0, 1.0))
    root = np.zeros((6 * len(held), 6 * len(held)))
    for index, sigma in enumerate(prior.sigma):
        covariance = 0.5 * (walk + own) if index == _TURN else walk
        level, axes = np.linalg.eigh(covariance)
        root[index::6, index::6] = sigma * axes * np.sqrt(np.maximum(level, 0.0))
    return root


def _walk(held: Bools) -> Floats:
    """Return (views, views): the covariance of steps of variance 1 between neighbours."""
    views = len(held)
    steps = np.diff(np.eye(views), axis=0)
    # the walk given that it is 0 at each view that is held
    precision = steps.T @ steps + np.diag(np.where(held, 1e9, 1e-6))
    covariance = np.linalg.inv(precision)
    covariance[held] = 0.0
    covariance[:, held] = 0.0
    return np.asarray((covariance + covariance.T) / 2)


def require_sigmas(prior: object) -> None:
    """
    Refuse a prior dataclass with a sigma that is none.

    :raises ParameterError: names the sigma
    """
    for field in fields(prior):  # type: ignore[arg-type]
        value = getattr(prior, field.name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(
                f'prior: {field.name}: {value} is no standard deviation; it must be 0 or more'
            )
