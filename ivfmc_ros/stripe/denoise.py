# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points that are no surface."""

from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Profile


def near_neighbours(profile: Profile, threshold: float, least: int = 3) -> Bools:
    """
    Tell which points of a profile are no noise.

    The paper's criterion (Ismail et al. 2007): the stripe is followed from point to point; where
    the distance to the next one exceeds the threshold the stripe is broken, and a piece of fewer
    than ``least`` points is noise.

    threshold : metres
    returns : (n,) bool
    """
    if len(profile) == 0:
        return np.zeros(0, dtype=bool)
    steps = np.linalg.norm(np.diff(profile.points_xyz, axis=0), axis=1)
    piece = np.concatenate([[0], np.cumsum(steps > threshold)])
    return np.asarray(np.bincount(piece)[piece] >= least)


def keep(profile: Profile, chosen: Bools) -> Profile:
    """Return the profile with only the chosen points, (n,) bool."""
    return replace(
        profile,
        points_xyz=profile.points_xyz[chosen],
        intensity=profile.intensity[chosen],
        sigma=profile.sigma[chosen],
        uv=profile.uv[chosen],
        colour=None if profile.colour is None else profile.colour[chosen],
    )
