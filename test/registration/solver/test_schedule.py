# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.surfaces import block
from support.surfaces import moved
from support.surfaces import slip

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.gauss_newton import solve_jointly
from ivfmc_ros.registration.solver.prior import pose_root
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.schedule import coarse_reaches
from ivfmc_ros.registration.solver.schedule import QUICK
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.table import surface_patches


@pytest.mark.parametrize(
    ('reach', 'last', 'expected'),
    [(1.0, 0.3, [1.0, 0.4]), (1.0, 1.0, [1.0]), (0.2, 1.0, [0.2])],
)
def test_reaches_end_above_the_last(reach, last, expected):
    assert coarse_reaches(reach, last) == pytest.approx(expected)


def test_quick_solution_is_that_of_all_steps_within_the_noise():
    views = [block(0), moved(block(1, offset=1.3e-3), slip())]
    patches, edge = surface_patches(views, 700)
    scene = Scene(patches=patches, slopes=None, edge=edge)
    root = pose_root(TablePrior(), np.array([True, False]))
    corner = np.array([[0.02, 0.02, 0.0]])
    quick, thorough = (
        transforms.apply(solve_jointly(scene, root, 1.5e-3, pace=pace).poses[1], corner)
        for pace in (QUICK, THOROUGH)
    )
    assert np.abs(quick - thorough).max() < 3e-6
    assert np.abs(quick - corner).max() > 5e-5
