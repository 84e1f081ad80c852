# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Statistics of one measured value over many scans: run chart, process capability.

Cp and Cpk take the standard deviation from the mean moving range of two, Pp and Ppk from all
values (ISO 22514-2). The confidence interval of Cpk is that of Bissell, Applied Statistics 39
(1990) 331.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.storage.catalogue.rows import FeatureRow
from ivfmc_ros.storage.catalogue.rows import FoundScan

# Mean range of two normal values in standard deviations (d2).
_D2 = 1.128
# Control limits are three standard deviations from the mean.
_LIMIT = 3.0
# Half width of a 95 % interval, standard deviations.
_K95 = 1.96
# Characteristics with an upper limit only: they cannot be negative.
_ONE_SIDED = ('position', 'flatness', 'cylindricity', 'sphericity')


@dataclass(frozen=True, eq=False, kw_only=True)
class Capability:
    """
    Statistics of a measured value; lengths in meters, NaN where a number is not determined.

    values : (n,) in the order of the scans
    sigma, sigma_overall : standard deviation by the moving range, and of all values
    lower, upper : tolerance limits, NaN where there is none
    control : lower and upper control limit of single values
    cpk_95 : half width of the 95 % interval of Cpk
    outside : number of values outside of the control limits
    failed : number of values outside of the tolerance
    unmeasured : number of scans in which the value was not measured
    """

    feature: str
    characteristic: str
    values: Floats
    mean: float
    sigma: float
    sigma_overall: float
    lower: float
    upper: float
    control: tuple[float, float]
    cp: float
    cpk: float
    cpk_95: float
    pp: float
    ppk: float
    outside: int
    failed: int
    unmeasured: int


def capability(scans: Sequence[FoundScan]) -> Capability:
    """
    Return the statistics of the value that a list of scans has.

    scans : of one feature and characteristic, see ``ScanFilter``
    :raises ParameterError: fewer than two scans have the value, the scans have several
        characteristics, or different nominals or tolerances
    """
    rows = [scan.value for scan in scans if scan.value is not None]
    measured = [row for row in rows if row.measured is not None]
    if len(measured) < 2:
        raise ParameterError(
            f'feature: {len(measured)} scans have a measured value; statistics need two'
        )
    first = _only(measured)
    values = np.array([row.measured for row in measured], dtype=np.float64)
    lower, upper = _limits(first)
    mean, overall = float(values.mean()), float(values.std(ddof=1))
    sigma = float(np.abs(np.diff(values)).mean()) / _D2
    control = mean - _LIMIT * sigma, mean + _LIMIT * sigma
    cpk = _index(mean, sigma, lower, upper)
    return Capability(
        feature=first.feature,
        characteristic=first.characteristic,
        values=values,
        mean=mean,
        sigma=sigma,
        sigma_overall=overall,
        lower=lower,
        upper=upper,
        control=control,
        cp=_ratio(upper - lower, 6.0 * sigma),
        cpk=cpk,
        cpk_95=_K95 * math.sqrt(1.0 / (9.0 * len(values)) + cpk**2 / (2.0 * (len(values) - 1))),
        pp=_ratio(upper - lower, 6.0 * overall),
        ppk=_index(mean, overall, lower, upper),
        outside=int(np.count_nonzero((values < control[0]) | (values > control[1]))),
        failed=int(np.count_nonzero((values < lower) | (values > upper))),
        unmeasured=len(rows) - len(measured),
    )


def _only(rows: Sequence[FeatureRow]) -> FeatureRow:
    """:raises ParameterError: the rows are of several values."""
    names = sorted({row.characteristic for row in rows})
    if len(names) > 1:
        raise ParameterError(f'feature: has {", ".join(names)}; name one by --characteristic')
    for key in ('nominal', 'tolerance'):
        found = sorted({getattr(row, key) for row in rows}, key=str)
        if len(found) > 1:
            texts = ', '.join(
                'none' if value is None else f'{value * 1e3:g} mm' for value in found
            )
            raise ParameterError(
                f'feature: the {key} differs between scans ({texts}); choose scans of one by '
                '--since and --until'
            )
    return rows[0]


def _limits(row: FeatureRow) -> tuple[float, float]:
    if row.tolerance is None or row.nominal is None:
        return math.nan, math.nan
    if row.characteristic in _ONE_SIDED:
        return math.nan, row.tolerance
    return row.nominal - row.tolerance, row.nominal + row.tolerance


def _index(mean: float, sigma: float, lower: float, upper: float) -> float:
    """Return the distance of the mean to the nearer limit in units of three sigma."""
    sides = [side for side in (upper - mean, mean - lower) if not math.isnan(side)]
    return _ratio(min(sides, default=math.nan), 3.0 * sigma)


def _ratio(value: float, by: float) -> float:
    return value / by if by > 0.0 else math.nan
