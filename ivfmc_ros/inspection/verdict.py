# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Verdicts by ISO 14253-1: pass, fail or not decided, from deviation, uncertainty and tolerance.

Pass: within the tolerance by more than the guard band of the measurement uncertainty. Fail:
outside by more than the guard band. In between the measurement does not decide. What has too few
good points, or an unknown uncertainty, gets no verdict at all.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_in_range

PASS, FAIL, NOT_DECIDED = 'pass', 'fail', 'not decided'
NOT_MEASURED = 'not measured well enough'
NO_UNCERTAINTY = 'no uncertainty known'
VERDICTS = (FAIL, NO_UNCERTAINTY, NOT_DECIDED, NOT_MEASURED, PASS)
# Guard band in standard uncertainties: one-sided probability of 95 % (ISO 14253-1, 2017).
GUARD = 1.645
# Greatest expanded uncertainty of a vertex that decides, as a fraction of the tolerance: the usual
# limit of the capability of a measurement (VDI/VDE 2634-2, 5.4: 1/3 to 1/10).
MAX_U_RATIO = 1.0 / 3.0
# Fraction of the vertices of a surface that may be outside the tolerance: dust and outliers.
_MAX_OUTLIERS = 0.001


def require_tolerance(tolerance: float, name: str = 'tolerance') -> None:
    """:raises ParameterError: a tolerance is not positive."""
    require_in_range(name, tolerance, 0.0, 1.0, 'm', open_low=True)


def judge(deviation: float, uncertainty: float, tolerance: float) -> str:
    """
    Return the verdict on one deviation, for example a diameter minus its nominal, meters.

    uncertainty : standard uncertainty (1 sigma); NaN if it is not known
    """
    if not np.isfinite(uncertainty):
        return NO_UNCERTAINTY
    guard = GUARD * uncertainty
    if not np.isfinite(deviation):
        return NOT_MEASURED
    if abs(deviation) <= tolerance - guard:
        return PASS
    return FAIL if abs(deviation) > tolerance + guard else NOT_DECIDED


def judge_surface(
    deviations: Floats, uncertainty: Floats, tolerance: float, strays: int = 0
) -> str:
    """
    Return the verdict on the deviations (n,) of a surface with standard uncertainties (n,).

    strays : number of vertices of a patch that is too small to be resolved: on a small face, 0.1 %
        of the vertices is less than one outlier
    """
    size = np.abs(deviations)
    if not len(size):
        return NOT_MEASURED
    if not np.isfinite(uncertainty).all():
        return NO_UNCERTAINTY
    guard = GUARD * uncertainty
    allowed = max(_MAX_OUTLIERS * len(size), strays)
    if np.count_nonzero(size > tolerance + guard) > allowed:
        return FAIL
    return PASS if np.count_nonzero(size > tolerance - guard) <= allowed else NOT_DECIDED


def overall(verdicts: set[str]) -> str:
    """
    Return the verdict on a part from those on its surfaces and features.

    Surfaces and features that were not measured well enough are listed with their coverage; if
    nothing was, the part is not judged.
    """
    for verdict in (FAIL, NO_UNCERTAINTY, NOT_DECIDED, PASS):
        if verdict in verdicts:
            return verdict
    return NOT_MEASURED
