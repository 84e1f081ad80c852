# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far measured points are from a nominal surface."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Distances in metres: root mean square, 95th percentile, largest, signed mean."""

    count: int
    rms: float
    p95: float
    worst: float
    mean: float


def summarise(distances: Floats) -> Deviation:
    """
    Sum up (n,) signed distances in metres.

    :raises GeometryError: there is none, or one is not finite
    """
    if not len(distances):
        raise GeometryError('deviation: no point to compare')
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
