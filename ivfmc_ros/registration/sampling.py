# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the profiles of a view are close enough for its surfels to lie on the surface.

A quadric through distant profiles, around an edge or through both sides of a thin wall, is not the
surface. This is measured on the view itself: every second profile against the profiles between,
which have the same laser, cell and table. Each half is twice as coarse as the view, so that where
both agree within their noise, the view is sampled densely enough.
"""

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.table import fit_view_surfels
from ivfmc_ros.registration.views.assemble import select_columns

# Distances of the halves that judge a surfel: the nearest ones, at least, and how far away, in
# surfel spacings of the halves.
_NEIGHBORS, _MIN_NEIGHBORS, _SEARCH_RADIUS = 5, 3, 2.0
# Their mean in standard deviations is 0.8 for noise alone. Chosen on a box, a wall of 2 mm and
# spheres of 6 to 20 mm radius beside the axis, 24 to 90 profiles a turn: of the surfels below it
# the lasers differ by up to 0.9 of their noise at exact calibration.
_MAX_NOISE_RATIO = 3.0


def is_well_sampled(view: View, surfels: Surfels, max_distance: float, max_samples: int) -> Bools:
    """
    Return (n,) whether both halves of a view agree at each of its surfels.

    max_distance : meters, greatest distance of corresponding surfels along the normal
    max_samples : target number of samples of each half
    """
    nothing = np.zeros(len(surfels), dtype=bool)
    even = np.arange(len(view.angles)) % 2 == 0
    halves = [select_columns(view, even), select_columns(view, ~even)]
    fitted, spacing = fit_view_surfels(halves, max_samples)
    problem = RegistrationProblem(surfels=fitted, jacobian=None, spacing=spacing)
    blocks = find_overlaps(problem, Poses.identity(2).turntable_from_view, max_distance)
    places = np.concatenate([np.zeros((0, 3)), *(block.midpoint for block in blocks)])
    if len(places) < _NEIGHBORS or not len(surfels):
        return nothing
    ratios = np.concatenate([np.abs(block.residuals) / block.sigma for block in blocks])
    distance, index = cKDTree(places).query(
        surfels.points_xyz, k=_NEIGHBORS, distance_upper_bound=_SEARCH_RADIUS * spacing
    )
    known = np.isfinite(distance)
    total = np.where(known, np.append(ratios, 0.0)[index], 0.0).sum(axis=1)
    count = known.sum(axis=1)
    return np.asarray(
        (count >= _MIN_NEIGHBORS) & (total < _MAX_NOISE_RATIO * np.maximum(count, 1))
    )
