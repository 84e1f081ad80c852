# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest
from support.clock import Clock

from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.progress import ScanProgress
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import Stage

MOTION = MotionLimits()


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def plan():
    request = ScanRequest(profiles=200, closure=0.0, motion='step')
    return make_plan(request, ('left', 'right'), MOTION, 0.0)


@pytest.fixture
def progress(plan, clock):
    found = ScanProgress(plan, MOTION, clock)
    found.set_stage(Stage.PREPARING)
    found.set_stage(Stage.SCANNING)
    return found


def test_lead_in_does_not_count_as_more_than_the_plan(progress):
    progress.set_recorded_profiles(1000)
    assert (progress.profiles_done, progress.profiles_total) == (400, 400)


def test_remaining_time_follows_the_pace_of_the_scan(progress, clock):
    planned = progress.eta_s()
    clock.now_s += 40.0
    progress.set_recorded_profiles(200)
    # half of them in 40 s
    assert progress.eta_s() < planned
    assert progress.eta_s() == pytest.approx(0.5 * (0.5 * 80 + 0.5 * 0.6 * 400) + 20.0, rel=0.01)


def test_what_is_taken_again_is_more_work(progress, plan):
    before = progress.eta_s()
    (sweep,) = plan.sweeps
    denser = replace(sweep, views=(2, 3), profiles=500, retake_of=0)
    progress.set_begun([sweep, denser])
    assert progress.profiles_total == 400 + 1000
    assert progress.eta_s() == pytest.approx(before + (0.6 + 0.05) * 1000)
    progress.set_recorded_profiles(900)
    assert progress.profiles_done == 900
    progress.set_stage(Stage.REGISTERING)
    assert progress.profiles_done == 1400
