# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check of the scale: the length of the target on the platter, measured over nominal.

The board of camera and lasers gives the scale of the cell; stripes on the platter measure the
target on it in this scale. A ratio other than 1 means that one of the two known lengths is wrong.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.observations import Target

# Coverage factor of the expanded uncertainty (GUM 6.3: about 95 %).
_COVERAGE = 2.0
# Relative difference that two prints of one printer have; a smaller one is no doubt (as the prior
# of the joint adjustment, and the limit for the stretch of a board).
_MIN_DOUBT = 5e-4
# Expanded relative uncertainty from which the comparison says too little to be called a check:
# ten times the difference that it should find.
_MAX_CHECK_U = 10 * _MIN_DOUBT
# Relative standard uncertainty of the imaged side of single markers: blur and the response of the
# camera change it by 0.4 to 2 % (as the prior of the joint adjustment).
MARKER_U = 1e-2
# Share of the prior in the variance of a result from which the data have said nothing.
_PRIOR_ONLY = 0.99
_MM_PER_100 = 100.0  # a relative error as millimeters in 100 mm


@dataclass(frozen=True, kw_only=True)
class ScaleCheck:
    """
    Comparison of the target on the platter with the scale of the cell.

    ratio : measured over nominal length of the target
    u : relative standard uncertainty of the ratio
    """

    ratio: float
    u: float

    @property
    def difference(self) -> float:
        """Measured minus nominal length, over nominal length."""
        return self.ratio - 1.0

    @property
    def expanded_u(self) -> float:
        """Expanded relative uncertainty (k = 2)."""
        return _COVERAGE * self.u

    @property
    def is_doubtful(self) -> bool:
        """Whether the two known lengths contradict each other."""
        return not abs(self.difference) <= max(self.expanded_u, _MIN_DOUBT)

    def without_prior(self, prior_std: float) -> 'ScaleCheck | None':
        """
        Return the check by the pictures alone: a prior of 1 pulls the ratio towards 1.

        prior_std : relative standard deviation of the prior that the ratio was adjusted with
        returns : None if the pictures said nothing
        """
        share = (self.u / prior_std) ** 2
        if not share < _PRIOR_ONLY:
            return None
        left = 1.0 - share
        return ScaleCheck(ratio=1.0 + self.difference / left, u=self.u / float(np.sqrt(left)))

    def with_length_u(self, u: float) -> 'ScaleCheck':
        """Return the check with the relative standard uncertainty of a known length added."""
        return ScaleCheck(ratio=self.ratio, u=float(np.hypot(self.u, u)))

    def __str__(self) -> str:
        return f'{self.ratio:.4f} ± {self.expanded_u:.4f} (k = 2)'


def measured_ratio(target: Target, axis: AxisState) -> float:
    """Return the measured over the nominal length of the target."""
    return axis.mean_side() / target.side if isinstance(target, Markers) else axis.scale


def scale_warnings(check: ScaleCheck | None, source: str, target: Target) -> list[str]:
    """
    Return what is doubtful in the scale, with its consequence and what to do; one line each.

    check : None if nothing compares the target with the scale of the cell
    source : ``TurntableCalibration.scale_source``
    """
    if source == 'markers':
        error = _MM_PER_100 * MARKER_U
        return [
            f'the distance of the axis comes from the side of the markers {target}, whose image '
            f'blur and exposure change by about {MARKER_U:.0%}: lengths on the platter may be off '
            f'by {error:.0f} mm in 100 mm against those of the laser; add --stripe-pictures, or '
            'use a ChArUco board'
        ]
    if check is None:
        return []
    if not check.is_doubtful:
        return _weak_check(check, target)
    error, sense = _MM_PER_100 * abs(check.difference), 'large' if check.ratio > 1.0 else 'small'
    marker = isinstance(target, Markers)
    image = ', or blur and exposure change the image of the markers (use a ChArUco board)'
    return [
        f'scale: the laser measures {target} {check.ratio:.4f} times as long as stated, with '
        f'U = {check.expanded_u:.4f} (k = 2). Either all lengths of this cell are '
        f'{100 * abs(check.difference):.2f} % too {sense} ({error:.2f} mm in 100 mm), or the '
        f'stated length of {target} is wrong{image if marker else ""}. Measure both prints with a '
        'caliper over as many squares or markers as possible and calibrate again with the true '
        'lengths; make sure that the camera has the focus of its calibration, and that the board '
        'of the laser was stated as it is'
    ]


def _weak_check(check: ScaleCheck, target: Target) -> list[str]:
    if check.expanded_u <= _MAX_CHECK_U:
        return []
    error = _MM_PER_100 * check.expanded_u
    return [
        f'scale: the laser measures {target} {check.ratio:.4f} times as long as stated, but with '
        f'U = {check.expanded_u:.4f} (k = 2): an error of up to {error:.1f} mm in 100 mm is not '
        'seen. Calibrate the laser with the board at the distance of the platter, and take '
        'more pictures of the stripe on it'
    ]
