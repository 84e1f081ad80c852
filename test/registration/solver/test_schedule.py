# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.surfaces import moved
from support.surfaces import slip
from support.surfaces import wavy_view

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.gauss_newton import solve_registration
from ivfmc_ros.registration.solver.prior import pose_prior_factor
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.schedule import coarse_distances
from ivfmc_ros.registration.solver.schedule import QUICK
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.table import fit_view_surfels


@pytest.mark.parametrize(
    ('first', 'last', 'expected'),
    [(1.0, 0.3, [1.0, 0.4]), (1.0, 1.0, [1.0]), (0.2, 1.0, [0.2])],
)
def test_distances_end_above_the_last(first, last, expected):
    assert coarse_distances(first, last) == pytest.approx(expected)


def test_quick_solution_is_that_of_all_steps_within_the_noise():
    views = [wavy_view(0), moved(wavy_view(1, offset=1.3e-3), slip())]
    surfels, spacing = fit_view_surfels(views, 700)
    problem = RegistrationProblem(surfels=surfels, jacobian=None, spacing=spacing)
    factor = pose_prior_factor(TablePrior(), np.array([True, False]))
    corner = np.array([[0.02, 0.02, 0.0]])
    quick, thorough = (
        transforms.apply(
            solve_registration(problem, factor, 1.5e-3, schedule=schedule).poses[1], corner
        )
        for schedule in (QUICK, THOROUGH)
    )
    assert np.abs(quick - thorough).max() < 3e-6
    assert np.abs(quick - corner).max() > 5e-5
