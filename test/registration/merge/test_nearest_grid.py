# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.registration.merge.nearest_grid import NearGrid


def test_points_found_are_about_the_nearest():
    rng = np.random.default_rng(1)
    points, asked = rng.uniform(0, 0.05, (500, 3)), rng.uniform(-0.01, 0.06, (40, 50, 3))
    grid = NearGrid.of(points, 5e-4, 4e-3)
    found = grid.find(asked)
    nearest, _ = cKDTree(points).query(asked)
    missing = found < 0
    assert nearest[missing].min() > 4e-3 - 2e-3
    distance = np.linalg.norm(asked - points[found], axis=2)
    # two cells' diagonals may stand between what is nearest and what is found
    assert (distance[~missing] - nearest[~missing]).max() < 2e-3
    assert missing[nearest > 4e-3 + 2e-3].all()


def test_far_away_there_is_none():
    grid = NearGrid.of(np.zeros((1, 3)), 1e-3, 2e-3)
    assert grid.find(np.array([[0.0, 0.0, 1e-4], [9.0, 0.0, 0.0], [0.0, -9.0, 0.0]])).tolist() == [
        0,
        -1,
        -1,
    ]
