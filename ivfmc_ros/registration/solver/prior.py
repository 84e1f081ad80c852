# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Priors of the registration: standard deviations of the table's poses and of the cell."""

from dataclasses import dataclass
from dataclasses import fields
import math

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

_YAW = 2  # index of the rotation about z in a pose's parameters
# Highest order of the table's periodic error: two lasers 66 degrees apart, as in the bench cell,
# observe no higher order well.
_MAX_ORDERS = 11


@dataclass(frozen=True, kw_only=True)
class TablePrior:
    """
    Prior standard deviations of a view's pose about the table's, frame ``turntable``.

    0 fixes a component.

    angle : radians about the axis (slip of table or part)
    tilt : radians about x and y (wobble)
    offset : meters along x and y
    height : meters along z
    :raises ParameterError: a value is negative or not finite
    """

    angle: float = math.radians(0.2)
    tilt: float = math.radians(0.05)
    offset: float = 2e-4
    height: float = 5e-5

    def __post_init__(self) -> None:
        require_standard_deviations(self)

    @property
    def sigma(self) -> Floats:
        """(6,) standard deviations: rotation vector in radians, translation in meters."""
        tilt, offset = self.tilt, self.offset
        return np.array([tilt, tilt, self.angle, offset, offset, self.height])


@dataclass(frozen=True, kw_only=True)
class CellPrior:
    """
    Prior standard deviations of the errors of a cell, radians and meters.

    axis_offset, axis_tilt : of the axis, across it
    angle : of the table's periodic error at any angle, to which all orders contribute equally
    orders : number of orders of the periodic error, 1 to 11
    backlash : between sweeps of opposite direction
    laser_tilt, laser_offset : of each plane, about and from the middle of the volume; the offset
        is the displacement by a rotation by the tilt about a point 30 mm aside
    :raises ParameterError: a value is negative or not finite, or ``orders`` out of range
    """

    axis_offset: float = 1e-4
    axis_tilt: float = math.radians(0.05)
    angle: float = math.radians(0.1)
    orders: int = 6
    backlash: float = math.radians(0.05)
    laser_tilt: float = math.radians(0.05)
    laser_offset: float = 2.5e-5

    def __post_init__(self) -> None:
        require_standard_deviations(self)
        require_in_range('prior: orders', self.orders, 1, _MAX_ORDERS)


def pose_prior_factor(prior: TablePrior, fixed: Bools) -> Floats:
    """
    Return L, (6 views, 6 views), a factor of the prior covariance L L' of all poses.

    A part that has moved stays where it is, and lost steps stay lost: from view to view the
    error is a random walk that starts at the fixed views. Half of the angle's variance is
    independent for each view.

    fixed : (views,) bool, views whose poses do not change
    """
    walk = _random_walk(fixed)
    independent = np.diag(np.where(fixed, 0.0, 1.0))
    factor = np.zeros((6 * len(fixed), 6 * len(fixed)))
    for index, sigma in enumerate(prior.sigma):
        covariance = 0.5 * (walk + independent) if index == _YAW else walk
        eigenvalues, axes = np.linalg.eigh(covariance)
        factor[index::6, index::6] = sigma * axes * np.sqrt(np.maximum(eigenvalues, 0.0))
    return factor


def _random_walk(fixed: Bools) -> Floats:
    """Return (views, views), the covariance of a walk with steps of variance 1 between views."""
    views = len(fixed)
    steps = np.diff(np.eye(views), axis=0)
    # conditioned on 0 at each fixed view
    precision = steps.T @ steps + np.diag(np.where(fixed, 1e9, 1e-6))
    covariance = np.linalg.inv(precision)
    covariance[fixed] = 0.0
    covariance[:, fixed] = 0.0
    return np.asarray((covariance + covariance.T) / 2)


def require_standard_deviations(prior: object) -> None:
    """
    Check that every field of a prior dataclass is a standard deviation.

    :raises ParameterError: a field is negative or not finite; the message names it
    """
    for field in fields(prior):  # type: ignore[arg-type]
        value = getattr(prior, field.name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(
                f'prior: {field.name}: {value} is not a standard deviation; it must be finite '
                'and 0 or more'
            )
