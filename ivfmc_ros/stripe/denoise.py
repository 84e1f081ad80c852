# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Noise removal along a stripe by the distance of neighboring points (Ismail et al. 2007)."""

from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile


def filter_by_neighbor_distance(points_xyz: Floats, threshold: float, least: int = 3) -> Bools:
    """
    Return a mask of the points that belong to a long enough segment of the stripe.

    The stripe is split where the distance between consecutive points exceeds the threshold;
    segments with fewer than ``least`` points are noise (Ismail et al. 2007).

    points_xyz : (n, 3) meters, in order along the stripe
    threshold : meters
    least : points
    returns : (n,) bool, False for noise
    """
    if len(points_xyz) == 0:
        return np.zeros(0, dtype=bool)
    steps = np.diff(points_xyz, axis=0)
    is_break = (steps * steps).sum(axis=1) > threshold**2
    segment = np.concatenate([[0], np.cumsum(is_break)])
    return np.asarray(np.bincount(segment)[segment] >= least)


def select_points(profile: Profile, chosen: Bools | Ints) -> Profile:
    """Return the profile with the chosen points only; a (n,) bool mask or (k,) indices."""
    return replace(
        profile,
        points_xyz=profile.points_xyz[chosen],
        intensity=profile.intensity[chosen],
        sigma=profile.sigma[chosen],
        uv=profile.uv[chosen],
        color=None if profile.color is None else profile.color[chosen],
    )
