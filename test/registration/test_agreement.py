# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import math

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.agreement import find_disagreement
from ivfmc_ros.registration.agreement import stated_rms
from ivfmc_ros.registration.sections import split_sections
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.registration.views.assemble import assemble

CELL = small_cell()
SPHERE = Sphere(np.array([0.012, 0.003, 0.045]), 0.02)


def views(apart=0.0, sense=1.0):
    """A sphere as two lasers see it: the second ``apart`` meters off, the table turned around."""
    profiles = []
    for laser in (0, 1):
        for profile in sphere_profiles(CELL, SPHERE, 90, laser=laser, view=laser):
            # measured at another angle than it was taken at
            change = sense * profile.angle - profile.angle
            points = profile.points_xyz @ transforms.rotation_z(-change).T
            points += np.array([apart * laser, 0.0, 0.0])
            angle = sense * profile.angle
            profiles.append(replace(profile, points_xyz=points, angle=angle, seq=len(profiles)))
    return assemble(CELL, profiles)


def disagreement(views, rms=0.0):
    return find_disagreement(split_sections(views), rms)


def stating(residual_rms):
    lasers = tuple(replace(laser, residual_rms=residual_rms) for laser in CELL.lasers)
    turntable = replace(CELL.turntable, residual_rms=residual_rms)
    return replace(CELL, lasers=lasers, turntable=turntable)


def test_lasers_that_see_one_surface_agree():
    assert disagreement(views()) == ''


@pytest.mark.parametrize(('apart', 'sense'), [(1e-3, 1.0), (0.0, -1.0)])
def test_surface_that_does_not_fit_is_said(apart, sense):
    found = disagreement(views(apart, sense))
    assert 'of the surface that two lasers measured fits within 0.12 mm' in found
    assert 'sense of rotation' in found


def test_sides_of_one_laser_that_are_near_each_other_need_not_fit():
    # as a slip would show it, on sides that the laser measured once
    (near, _) = views()
    assert disagreement([near, replace(views(1e-3)[1], laser=0)]) == ''


def test_stated_errors_of_the_calibration_are_allowed():
    assert disagreement(views(1e-3), rms=5e-4) == ''
    assert disagreement(views(1e-3), rms=5e-5) != ''
    assert stated_rms(stating(1e-4)) == pytest.approx(1e-4 * math.sqrt(3.0))
    assert stated_rms(stating(math.nan)) == 0.0
    assert stated_rms(None) == 0.0


def test_scan_whose_lasers_disagree_is_not_ok():
    found = check_registration(views(1e-3), Poses.identity(2), [])
    assert found.code == 'NOT_CONVERGED'
    assert check_registration(views(1e-3), Poses.identity(2), [], stating(1e-3)).code != (
        'NOT_CONVERGED'
    )
