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


def summarize(distances: Floats) -> Deviation:
    """
    Return the statistics of (n,) signed distances in meters.

    :raises GeometryError: the array is empty or has values that are not finite
    """
    if not len(distances):
        raise GeometryError('deviation: there are no points to compare')
    if not np.isfinite(distances).all():
        raise GeometryError('deviation: a distance is not finite; remove invalid points first')
    size = np.abs(distances)
    return Deviation(
        count=len(distances),
        rms=float(np.sqrt(np.mean(distances**2))),
        p95=float(np.percentile(size, 95)),
        worst=float(size.max()),
        mean=float(np.mean(distances)),
    )
