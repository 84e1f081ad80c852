# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import math

import numpy as np
import pytest
from support.triggered import TriggeredSweep

from ivfmc_ros.registration.views.motion_fit import refit
from ivfmc_ros.registration.views.trigger import number_profiles

STEP = math.radians(0.8)
# Radians: stamps in nanoseconds, and the angle that the table turns in one.
EXACT = 1e-9


def numbered(sweep, step=None):
    fitted, motions = refit(sweep.profiles())
    found, (motion,) = number_profiles(fitted, motions, step or sweep.step)
    return fitted, found, motion.trigger


def errors(sweep, profiles):
    """Radians off the truth, without the constant that turns the whole part."""
    off = np.array([profile.angle for profile in profiles]) - sweep.true_angles(profiles)
    return off - np.median(off)


@pytest.mark.parametrize('span', [2 * math.pi, -2 * math.pi])
@pytest.mark.parametrize('seed', range(3))
def test_angles_are_those_of_the_steps_whatever_the_reports(span, seed):
    sweep = TriggeredSweep(step=STEP, span=span, seed=seed)
    fitted, found, trigger = numbered(sweep)
    assert (trigger.code, trigger.dropped, trigger.doubled) == ('', 0, 0)
    assert len(found) == trigger.kept >= 440
    assert np.abs(errors(sweep, found)).max() < EXACT
    assert np.abs(errors(sweep, fitted)).max() > 1e3 * EXACT


def random_sweep(seed):
    """Sweep with up to 20 % dropped, 10 % doubled and some false triggers, of any direction."""
    rng = np.random.default_rng([7, seed])
    return TriggeredSweep(
        step=math.radians(rng.choice([0.9, 0.6, 0.45, 0.3])),
        span=math.radians(rng.choice([360, -360, 120, -90, 400])),
        drop=rng.uniform(0.0, 0.2),
        double=rng.uniform(0.0, 0.1),
        noise=rng.uniform(0.0, 0.5) * (seed % 2),
        rate=rng.choice([5.0, 10.0, 50.0]),
        seed=seed,
    )


@pytest.mark.parametrize('seed', range(20))
def test_dropped_doubled_and_false_triggers_never_give_a_wrong_number(seed):
    sweep = random_sweep(seed)
    _, found, trigger = numbered(sweep)
    assert trigger.code == ''
    off = np.abs(errors(sweep, found))
    assert off.max() < 0.25 * sweep.step
    # a false trigger near a step whose own one was dropped
    assert np.count_nonzero(off > EXACT) <= 3
    assert trigger.dropped == len(trigger.dropped_angles)
    # by the true angles, all between the first and the last one are there or said to be missing
    steps = np.round(np.diff(sorted(sweep.true_angles(found))) / sweep.step).astype(int)
    assert steps.min() == 1
    assert trigger.dropped == np.sum(steps - 1)


def test_steps_without_a_picture_are_named_by_their_angles():
    sweep = TriggeredSweep(step=STEP, drop=0.1, seed=4)
    _, found, trigger = numbered(sweep)
    taken = {round((profile.angle - trigger.phase) / STEP) for profile in found}
    missing = {round((angle - trigger.phase) / STEP) for angle in trigger.dropped_angles}
    assert len(missing) == trigger.dropped > 20
    assert taken | missing == set(range(min(taken), max(taken) + 1))
    assert not taken & missing
    assert f'{trigger.dropped} steps without a picture' in trigger.detail


def test_of_a_doubled_trigger_the_picture_on_the_step_is_kept():
    sweep = TriggeredSweep(step=STEP, double=0.1, seed=5)
    fitted, found, trigger = numbered(sweep)
    assert trigger.doubled > 20
    assert trigger.doubled == len(fitted) - len(found) - trigger.spurious
    assert trigger.dropped == 0
    assert np.abs(errors(sweep, found)).max() < EXACT
    assert f'{trigger.doubled} doubled pictures left out' in trigger.detail


def test_two_pictures_of_a_step_that_cannot_be_told_apart_are_both_left_out():
    fitted, motions = refit(TriggeredSweep(step=STEP).profiles())
    copy = replace(fitted[200], seq=fitted[-1].seq + 1)
    found, (motion,) = number_profiles([*fitted[:201], copy, *fitted[201:]], motions, STEP)
    assert len(found) == len(fitted) - 1
    assert fitted[200].seq not in {profile.seq for profile in found}
    assert (motion.trigger.doubled, motion.trigger.dropped) == (2, 1)


def test_pictures_of_a_ramp_that_the_fit_has_not_seen_are_left_out():
    # the fit keeps some of them, whose angles run away by most of a step
    sweep = TriggeredSweep(step=math.radians(0.4), span=-2 * math.pi, drop=0.1, seed=0)
    fitted, found, _ = numbered(sweep)
    assert np.abs(errors(sweep, fitted)).max() > 0.5 * sweep.step
    assert np.abs(errors(sweep, found)).max() < EXACT


@pytest.mark.parametrize(
    ('step', 'reason'),
    [
        (0.81, 'pictures are 0.8'),
        (0.66, 'not on a grid'),
        (1.6, 'not on a grid'),
        (2.0, 'not on a grid'),
    ],
)
def test_wrong_step_is_refused_and_the_fitted_angles_are_kept(step, reason):
    fitted, found, trigger = numbered(TriggeredSweep(step=STEP), math.radians(step))
    assert trigger.code == 'TRIGGER_REFUSED'
    assert reason in trigger.detail
    assert found == fitted


def test_pictures_at_random_angles_are_refused():
    sweep = TriggeredSweep(step=math.radians(0.63), noise=40.0, drop=1.0)
    fitted, found, trigger = numbered(sweep)
    assert trigger.code == 'TRIGGER_REFUSED'
    assert found == fitted


def test_half_of_the_step_numbers_every_second_one():
    sweep = TriggeredSweep(step=STEP)
    _, found, trigger = numbered(sweep, STEP / 2)
    assert np.abs(errors(sweep, found)).max() < EXACT
    assert trigger.dropped == trigger.kept - 1


def test_steps_smaller_than_the_reports_can_tell_are_refused():
    fitted, motions = refit(TriggeredSweep(step=STEP).profiles())
    rng = np.random.default_rng(0)
    rough = [replace(p, angle=p.angle + rng.normal(0.0, 0.12 * STEP)) for p in fitted]
    found, (motion,) = number_profiles(rough, motions, STEP)
    assert motion.trigger.code == 'TRIGGER_REFUSED'
    assert 'scatter' in motion.trigger.detail
    assert found == rough


@pytest.mark.parametrize('lost', [0.5, -0.5])
def test_steps_that_the_table_loses_against_its_reports_are_a_slip(lost):
    fitted, found, trigger = numbered(TriggeredSweep(step=STEP, lost=lost * STEP))
    assert trigger.code == 'SLIPPED'
    assert 'disagree by' in trigger.detail
    assert found == fitted


@pytest.mark.parametrize('lost', [1.0, 2.0, -1.0])
def test_whole_steps_that_the_table_loses_do_not_pass_unnoticed(lost):
    fitted, found, trigger = numbered(TriggeredSweep(step=STEP, lost=lost * STEP))
    assert trigger.code in ('SLIPPED', 'TRIGGER_REFUSED')
    assert found == fitted


def test_trigger_line_that_adds_motor_steps_is_a_slip_at_its_angle():
    fitted, motions = refit(TriggeredSweep(step=STEP).profiles())
    moved = [
        replace(p, angle=p.angle + (0.3 * STEP if k > 200 else 0.0)) for k, p in enumerate(fitted)
    ]
    _, (motion,) = number_profiles(moved, motions, STEP)
    assert motion.trigger.code == 'SLIPPED'
    at = float(motion.trigger.detail.split('table angle of ')[1].split()[0])
    assert at == pytest.approx(math.degrees(fitted[200].angle), abs=16 * 0.8)


def test_all_sweeps_in_one_direction_share_the_grid():
    first = TriggeredSweep(step=STEP, seed=1)
    second = TriggeredSweep(step=STEP, seed=2, begin=40.0)
    fitted, motions = refit([*first.profiles(view=0), *second.profiles(view=1, first_seq=1000)])
    found, checked = number_profiles(fitted, motions, STEP)
    assert all(motion.trigger.shared for motion in checked)
    off = [
        np.array([p.angle for p in found if p.view == view])
        - sweep.true_angles([p for p in found if p.view == view])
        for view, sweep in enumerate((first, second))
    ]
    assert abs(off[0].mean() - off[1].mean()) < EXACT


def test_sweeps_whose_grids_differ_keep_their_own_and_that_is_said():
    first, second = TriggeredSweep(step=STEP, seed=1), TriggeredSweep(step=STEP, seed=2)
    fitted, motions = refit([*first.profiles(view=0), *second.profiles(view=1, first_seq=1000)])
    moved = [replace(p, angle=p.angle + 0.4 * STEP) if p.view else p for p in fitted]
    _, checked = number_profiles(moved, motions, STEP)
    assert not any(motion.trigger.shared for motion in checked)
    assert all('not put on one grid' in motion.trigger.detail for motion in checked)


def test_table_without_a_constant_speed_is_refused():
    profiles = TriggeredSweep(step=STEP, lost=math.radians(4.0)).profiles()
    fitted, motions = refit(profiles)
    assert motions[0].why
    found, (motion,) = number_profiles(fitted, motions, STEP)
    assert motion.trigger.code == 'TRIGGER_REFUSED'
    assert found == fitted


def test_without_a_trigger_and_at_standstill_nothing_changes():
    fitted, motions = refit(TriggeredSweep(step=STEP).profiles())
    assert number_profiles(fitted, motions, 0.0) == (fitted, motions)
    stepped = [replace(p, speed=0.0) for p in fitted]
    still, motions = refit(stepped)
    assert number_profiles(still, motions, STEP) == (still, motions)


def test_few_pictures_are_refused():
    sweep = TriggeredSweep(step=math.radians(9.0), span=math.radians(95.0))
    fitted, motions = refit(sweep.profiles())
    _, (motion,) = number_profiles(fitted, motions, math.radians(9.0))
    assert motion.trigger.code == 'TRIGGER_REFUSED'
