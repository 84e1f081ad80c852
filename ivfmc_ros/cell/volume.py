# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Working volume of a cell: a cylinder about the turntable axis."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range


@dataclass(frozen=True, kw_only=True)
class Volume:
    """
    A cylinder in ``turntable_base``; points outside of it are discarded.

    radius, bottom, top : meters; bottom and top are heights above the platter
    :raises ParameterError: a value is out of range, or bottom is not below top
    """

    radius: float = 0.060
    bottom: float = 0.0
    top: float = 0.100

    def __post_init__(self) -> None:
        require_in_range('radius', self.radius, 0.0, 10.0, 'm', open_low=True)
        if not -1.0 <= self.bottom < self.top <= 10.0:
            raise ParameterError(
                f'bottom, top: {self.bottom} m to {self.top} m is no height range; '
                'bottom must be below top, from -1 m to 10 m'
            )

    def contains(self, points_xyz: Floats) -> Bools:
        """Return (...) bool, which of (..., 3) points are inside; NaN is not."""
        with np.errstate(invalid='ignore'):
            near = np.hypot(points_xyz[..., 0], points_xyz[..., 1]) <= self.radius
            z = points_xyz[..., 2]
            return np.asarray(near & (z >= self.bottom) & (z <= self.top))
