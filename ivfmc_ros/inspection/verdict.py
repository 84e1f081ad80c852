# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Pass, fail or not decided, by ISO 14253-1.

Within a tolerance is only what is within by more than the guard band of the measurement; outside
is only what is outside by more. In between, the measurement is not good enough to tell.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

PASS, FAIL, NOT_DECIDED = 'pass', 'fail', 'not decided'
# Guard band for a probability of 95 % on one side, in standard uncertainties.
GUARD = 1.645
# So many of the vertices may be outside of a surface's tolerance: dust and single outliers.
_STRAYS = 0.001


def require_tolerance(tolerance: float) -> None:
    """:raises ParameterError: a tolerance is not positive."""
    require_in_range('tolerance', tolerance, 0.0, 1.0, 'm', open_low=True)


def judge(deviation: float, uncertainty: float, tolerance: float) -> str:
    """
    Judge one figure, for example a diameter less its nominal. All are metres.

    uncertainty : standard (1 sigma)
    """
    guard = GUARD * uncertainty
    if not np.isfinite(deviation + guard):
        return NOT_DECIDED
    if abs(deviation) <= tolerance - guard:
        return PASS
    return FAIL if abs(deviation) > tolerance + guard else NOT_DECIDED


def judge_surface(deviations: Floats, uncertainty: Floats, tolerance: float) -> str:
    """Judge (n,) deviations of a surface, each with its standard uncertainty, metres."""
    size = np.abs(deviations)
    guard = GUARD * np.nan_to_num(uncertainty, nan=np.inf)
    allowed = _STRAYS * len(size)
    if np.count_nonzero(size > tolerance + guard) > allowed:
        return FAIL
    return PASS if np.count_nonzero(size > tolerance - guard) <= allowed else NOT_DECIDED
