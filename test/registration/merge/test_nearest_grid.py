# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.registration.merge.nearest_grid import NearestGrid


def test_points_found_are_approximately_the_nearest():
    rng = np.random.default_rng(1)
    points, queries = rng.uniform(0, 0.05, (500, 3)), rng.uniform(-0.01, 0.06, (40, 50, 3))
    grid = NearestGrid.build(points, 5e-4, 4e-3)
    found = grid.query(queries)
    nearest, _ = cKDTree(points).query(queries)
    missing = found < 0
    assert nearest[missing].min() > 4e-3 - 2e-3
    distance = np.linalg.norm(queries - points[found], axis=2)
    # two cells' diagonals may stand between what is nearest and what is found
    assert (distance[~missing] - nearest[~missing]).max() < 2e-3
    assert missing[nearest > 4e-3 + 2e-3].all()


def test_no_point_is_found_beyond_the_search_radius():
    grid = NearestGrid.build(np.zeros((1, 3)), 1e-3, 2e-3)
    assert grid.query(
        np.array([[0.0, 0.0, 1e-4], [9.0, 0.0, 0.0], [0.0, -9.0, 0.0]])
    ).tolist() == [
        0,
        -1,
        -1,
    ]
