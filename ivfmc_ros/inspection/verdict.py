# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Verdicts by ISO 14253-1: pass, fail or not decided, from deviation, uncertainty and tolerance.

Pass: within the tolerance by more than the guard band of the measurement uncertainty. Fail:
outside by more than the guard band. In between the measurement does not decide.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

PASS, FAIL, NOT_DECIDED = 'pass', 'fail', 'not decided'
# Guard band in standard uncertainties: one-sided probability of 95 % (ISO 14253-1, 2017).
GUARD = 1.645
# Fraction of the vertices of a surface that may be outside the tolerance: dust and outliers.
_MAX_OUTLIERS = 0.001


def require_tolerance(tolerance: float) -> None:
    """:raises ParameterError: a tolerance is not positive."""
    require_in_range('tolerance', tolerance, 0.0, 1.0, 'm', open_low=True)


def judge(deviation: float, uncertainty: float, tolerance: float) -> str:
    """
    Return the verdict on one deviation, for example a diameter minus its nominal, meters.

    uncertainty : standard uncertainty (1 sigma)
    """
    guard = GUARD * uncertainty
    if not np.isfinite(deviation + guard):
        return NOT_DECIDED
    if abs(deviation) <= tolerance - guard:
        return PASS
    return FAIL if abs(deviation) > tolerance + guard else NOT_DECIDED


def judge_surface(deviations: Floats, uncertainty: Floats, tolerance: float) -> str:
    """Return the verdict on the deviations (n,) of a surface with standard uncertainties (n,)."""
    size = np.abs(deviations)
    guard = GUARD * np.nan_to_num(uncertainty, nan=np.inf)
    allowed = _MAX_OUTLIERS * len(size)
    if np.count_nonzero(size > tolerance + guard) > allowed:
        return FAIL
    return PASS if np.count_nonzero(size > tolerance - guard) <= allowed else NOT_DECIDED
