# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points that are no surface."""

from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile


def near_neighbours(points_xyz: Floats, threshold: float, least: int = 3) -> Bools:
    """
    Tell which points (n, 3) along a stripe are no noise.

    The paper's criterion (Ismail et al. 2007): the stripe is followed from point to point; where
    the distance to the next one exceeds the threshold the stripe is broken, and a piece of fewer
    than ``least`` points is noise.

    threshold : metres
    returns : (n,) bool
    """
    if len(points_xyz) == 0:
        return np.zeros(0, dtype=bool)
    steps = np.diff(points_xyz, axis=0)
    apart = (steps * steps).sum(axis=1) > threshold**2
    piece = np.concatenate([[0], np.cumsum(apart)])
    return np.asarray(np.bincount(piece)[piece] >= least)


def keep(profile: Profile, chosen: Bools | Ints) -> Profile:
    """Return the profile with only the chosen points, (n,) bool or their indices."""
    return replace(
        profile,
        points_xyz=profile.points_xyz[chosen],
        intensity=profile.intensity[chosen],
        sigma=profile.sigma[chosen],
        uv=profile.uv[chosen],
        color=None if profile.color is None else profile.color[chosen],
    )
