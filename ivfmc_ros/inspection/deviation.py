# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of signed distances between measured points and a nominal surface."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """
    Statistics of n signed distances, meters.

    p95, worst : 95th percentile and maximum of the absolute distances; mean : signed
    """

    count: int
    rms: float
    p95: float
    worst: float
    mean: float


def summarize(distances: Floats, weights: Floats | None = None) -> Deviation:
    """
    Return the statistics of (n,) signed distances in meters.

    weights : (n,) not negative, for example the area that each point stands for; all alike where
        it is None or zero
    :raises GeometryError: the array is empty or has values that are not finite
    """
    if not len(distances):
        raise GeometryError('deviation: there are no points to compare')
    if not np.isfinite(distances).all():
        raise GeometryError('deviation: a distance is not finite; remove invalid points first')
    if weights is not None and not weights.any():
        weights = None
    size = np.abs(distances)
    return Deviation(
        count=len(distances),
        rms=float(np.sqrt(np.average(distances**2, weights=weights))),
        p95=_percentile(size, 95.0, weights),
        worst=float(size.max()),
        mean=float(np.average(distances, weights=weights)),
    )


def _percentile(values: Floats, percent: float, weights: Floats | None) -> float:
    if weights is None:
        return float(np.percentile(values, percent))
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(np.interp(percent / 100.0 * share[-1], share, values[order]))
