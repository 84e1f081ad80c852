# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.surfaces import empty
from support.surfaces import wavy_view
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.model import Poses
from ivfmc_ros.registration.misfit import laser_misfit
from ivfmc_ros.registration.views.assemble import assemble


def two_lasers(apart):
    """The same surface as two lasers see it, the second higher by ``apart`` meters."""
    rng = np.random.default_rng(1)
    views = [wavy_view(0), replace(wavy_view(1, offset=1e-4), laser=1)]
    return [
        replace(
            view,
            points_xyz=view.points_xyz
            + 1e-5 * rng.standard_normal(view.points_xyz.shape)
            + (0.0, 0.0, apart * view.laser),
        )
        for view in views
    ]


def test_lasers_that_fit_give_no_advice():
    found = laser_misfit(two_lasers(0.0), Poses.identity(2))
    assert found.rms < 2.0 * found.noise
    assert found.correspondences > 1000
    assert found.advice == ''


def test_advice_is_to_calibrate_lasers_that_see_the_surface_apart():
    found = laser_misfit(two_lasers(1e-4), Poses.identity(2))
    assert found.rms == pytest.approx(9e-5, rel=0.15)
    assert 'calibrate the laser planes and the axis' in found.advice


def sphere_of_two_lasers(steps, apart=0.0):
    """A sphere beside the axis, the second laser's surface displaced by ``apart`` meters."""
    sphere, cell = Sphere(np.array([0.012, 0.003, 0.045]), 0.01), small_cell()
    rng = np.random.default_rng(1)
    profiles = []
    for laser in (0, 1):
        for profile in sphere_profiles(cell, sphere, steps, laser=laser, view=laser):
            noise = 2e-5 * rng.standard_normal(profile.points_xyz.shape)
            moved = profile.points_xyz + noise + (apart * laser, 0.0, 0.0)
            sigma = np.full(len(profile), 2e-5)
            profiles.append(replace(profile, points_xyz=moved, sigma=sigma, seq=len(profiles)))
    return assemble(cell, profiles)


def test_coarse_profiles_are_no_error_of_the_calibration():
    found = laser_misfit(sphere_of_two_lasers(24), Poses.identity(2))
    assert found.rms > 4.0 * found.noise
    assert found.judged == 0
    assert 'calibrate' not in found.advice
    assert 'take more profiles' in found.advice


def test_surface_that_is_sampled_densely_is_judged():
    fine = laser_misfit(sphere_of_two_lasers(90), Poses.identity(2))
    assert fine.judged > 0.8 * fine.correspondences
    assert fine.advice == ''
    apart = laser_misfit(sphere_of_two_lasers(90, apart=1e-4), Poses.identity(2))
    assert 'calibrate the laser planes and the axis' in apart.advice


def test_registered_views_are_judged_where_they_were_put():
    poses = Poses.identity(2)
    poses.turntable_from_view[1, 2, 3] = -1e-4
    assert laser_misfit(two_lasers(1e-4), poses).advice == ''


def test_one_laser_or_no_common_surface_gives_no_misfit():
    views = two_lasers(0.0)
    assert laser_misfit([views[0], replace(views[1], laser=0)], Poses.identity(2)) is None
    assert laser_misfit([views[0], empty(views[1])], Poses.identity(2)) is None
    assert laser_misfit([], Poses.identity(0)) is None
