# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from functools import cache
import math

import numpy as np
import pytest
from support.erring_table import erring_cell
from support.erring_table import stripes
from support.erring_table import Sweep
from support.slipping_scan import SlippingScan

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.closure import Closure
from ivfmc_ros.registration.sections import split_sections
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.parts.solids import plate

STEPS = 120
CELL = bench_cell()
PARTS = {
    'box': lambda: box((0.05, 0.025, 0.04)).moved(
        transforms.rigid(transforms.rotation_z(0.5), (0.004, 0.007, 0.0))
    ),
    'low box': lambda: box((0.06, 0.03, 0.012)).moved(
        transforms.rigid(transforms.rotation_z(0.3), (0.004, 0.003, 0.0))
    ),
    'cylinder': lambda: cylinder(0.02, 0.05),
    'plate': lambda: plate(0.07, 0.06, 0.006),
}


@cache
def turn(name):
    angles = 2.0 * np.pi * np.arange(STEPS) / STEPS
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    return stripes(CELL, PARTS[name](), sweeps, None)


def taken(name, degrees=0.0, after=0, **values):
    lines = turn(name)
    # the second sweep of ``turns`` goes backward in its reported angles only
    return SlippingScan(
        cell=CELL, stripes=lines, size=math.radians(degrees), after=after, seed=5, **values
    )


def check(scan):
    views = scan.views()
    poses, verdicts = align(views, 'joint')
    return check_registration(views, poses, verdicts)


@pytest.mark.parametrize(
    ('degrees', 'after', 'view'), [(0.5, 60, 0), (-5.0, 170, 1), (20.0, 40, 0)]
)
def test_slip_between_two_lasers_is_found(degrees, after, view):
    found = check(taken('box', degrees, after))
    assert found.code == 'SLIPPED'
    assert math.degrees(found.size) == pytest.approx(degrees, abs=0.2)
    assert found.view == view
    at = math.degrees((after % STEPS) * 2.0 * math.pi / STEPS)
    size = max(degrees, 0.0)
    assert math.degrees(found.angle_from) - 1.0 <= at + size
    assert at <= math.degrees(found.angle_to) + 1.0
    assert f'{math.degrees(found.size):+.2f} degrees (view {view}' in found.detail


@pytest.mark.parametrize('degrees', [1.0, -5.0, 20.0])
def test_slip_of_one_laser_shows_where_the_sweep_closes(degrees):
    found = check(taken('box', degrees, 50, lasers=(0,), closure=8))
    assert found.code == 'SLIPPED'
    if math.isfinite(found.size):
        assert math.degrees(found.size) == pytest.approx(degrees, abs=1.0)


def test_slip_shows_beside_a_top_that_fits_after_every_slip():
    found = check(taken('low box', 20.0, 40, lasers=(0,), closure=8))
    assert found.code == 'SLIPPED'
    assert 'unknown angle' in found.detail


@pytest.mark.parametrize(('degrees', 'after'), [(0.3, 80), (0.7, 20), (-0.4, 100)])
def test_small_slip_of_one_laser_shows_at_the_default_closure(degrees, after):
    # 15 degrees of 120 profiles a turn
    found = check(taken('box', degrees, after, lasers=(0,), closure=5))
    assert found.code == 'SLIPPED'
    assert math.degrees(found.size) == pytest.approx(degrees, abs=0.1)


@pytest.mark.parametrize('seed', [41, 42, 43])
def test_error_of_the_calibration_is_no_slip(seed):
    bad = erring_cell(CELL, np.random.default_rng(seed), offset=5e-5, tilt=0.025, laser_tilt=0.025)
    found = check(replace(taken('box'), cell=bad, seed=seed))
    assert found.code in ('OK', 'UNCHECKED')
    if found.code == 'UNCHECKED':
        assert 'an error of the calibration as well' in found.detail


def test_slip_that_the_registration_shares_between_the_views_is_found():
    # two thirds of the second sweep lag: its pose alone takes up most of it
    found = check(taken('box', -0.7, STEPS + 30))
    assert found.code == 'SLIPPED'
    assert math.degrees(found.size) == pytest.approx(-0.7, abs=0.1)


@pytest.mark.parametrize('name', PARTS)
def test_good_scan_is_ok(name):
    found = check(taken(name))
    assert found.round == (name == 'cylinder')
    assert found.code == ('UNCHECKED' if found.round else 'OK')
    assert (found.size, found.view) == (0.0, -1)
    assert found.compared > 0.6


@pytest.mark.parametrize('name', ['box', 'low box'])
@pytest.mark.parametrize('closure', [5, 8])
def test_good_scan_of_one_laser_with_closure_is_ok(closure, name):
    assert check(taken(name, lasers=(0,), closure=closure)).code == 'OK'


@pytest.mark.parametrize(('step', 'is_slip'), [(1.8, True), (4.4, False)])
def test_closure_of_profiles_far_apart_shows_no_small_slip(step, is_slip):
    views = taken('box', lasers=(0,), closure=8).views()
    before, *_, after = split_sections(views).items
    closure = Closure(
        before=before,
        after=after,
        size=math.radians(0.16),
        sigma=math.radians(0.02),
        step=math.radians(step),
    )
    assert closure.is_slip == is_slip
    assert closure.is_informative == (step > 2.0)


def test_slip_of_a_turned_part_changes_nothing_and_is_no_fault():
    found = check(taken('cylinder', 5.0, 60))
    assert found.code == 'UNCHECKED'
    assert 'round about the axis' in found.detail


def test_table_that_stands_while_it_reports_angles_is_not_ok():
    lines = [[stripes[0]] * STEPS for stripes in turn('box')]
    one = check(SlippingScan(cell=CELL, stripes=lines, lasers=(0,), closure=5, seed=1))
    assert one.code == 'UNCHECKED'
    assert 'the table did not turn' in one.detail
    # two lasers see two different solids of revolution
    both = check(SlippingScan(cell=CELL, stripes=lines, seed=1))
    assert both.code in ('NOT_CONVERGED', 'UNCHECKED')
    assert 'the table did not turn' in both.detail or 'sense of rotation' in both.detail


def test_one_sweep_without_closure_is_said_to_be_unchecked():
    found = check(taken('box', 5.0, 50, lasers=(0,)))
    assert found.code == 'UNCHECKED'
    assert 'closure' in found.detail


def test_profiles_far_apart_are_unchecked():
    lines = [stripes[::4] for stripes in turn('box')]
    views = SlippingScan(cell=CELL, stripes=lines, seed=1).views()
    found = check_registration(views, Poses.identity(2), [])
    assert found.code == 'UNCHECKED'
    assert 'more than 4.6 degrees apart' in found.detail


def test_no_surface_is_unchecked():
    view = taken('box').views()[0]
    empty = replace(view, points_xyz=np.full_like(view.points_xyz, np.nan))
    assert check_registration([empty], Poses.identity(1), []).code == 'UNCHECKED'
    assert check_registration([], Poses.identity(0), []).code == 'UNCHECKED'


def test_registration_that_did_not_converge_is_not_ok():
    views = taken('box').views()
    failed = Verdict(
        view=1,
        applied=False,
        why='table pose kept: the registration did not converge',
        failed=True,
    )
    found = check_registration(views, Poses.identity(2), [failed])
    assert found.code == 'NOT_CONVERGED'
    assert 'view 1: table pose kept: the registration did not converge' in found.detail
