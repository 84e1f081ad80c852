# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of a rendered part with a fault, through the sequence of the orchestrator, without ROS."""

import asyncio
from functools import cache
import math

import numpy as np
import pytest
from support.erring_table import noisy
from support.erring_table import stripes
from support.erring_table import Sweep

from ivfmc_ros.cell import transforms
from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import box

pytest.importorskip('rclpy')
from support.rendered_cell import Fault
from support.rendered_cell import LASERS
from support.rendered_cell import RenderedCell

STEPS, RATE = 120, 15.0


@cache
def turn():
    """Return the stripes of a turn of both lasers, with noise."""
    part = box((0.05, 0.03, 0.04)).moved(
        transforms.rigid(transforms.rotation_z(0.4), (0.005, 0.006, 0.0))
    )
    angles = 2.0 * np.pi * np.arange(STEPS) / STEPS
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    rng = np.random.default_rng(8)
    found = stripes(bench_cell(), part, sweeps, None)
    return [[noisy(stripe, rng) for stripe in lines] for lines in found]


def scan(lasers=2, **fault):
    request = ScanRequest(profiles=STEPS, lasers=LASERS[:lasers])
    motion = MotionLimits(profile_rate=RATE)
    plan = make_plan(request, LASERS, motion)
    tools = RenderedCell(bench_cell(), turn(), plan, motion, Fault(at=4.0, **fault))
    return asyncio.run(run_job(StateMachine(), plan, motion, tools))


@pytest.mark.parametrize('lasers', [1, 2])
def test_scan_without_a_fault_is_ok(lasers):
    outcome = scan(lasers)
    assert (outcome.code, outcome.detail) == ('OK', '')
    for view in outcome.completeness['views']:
        assert view['missing_deg'] == []
        assert view['retaken_as'] == []


@pytest.mark.parametrize('lasers', [1, 2])
@pytest.mark.parametrize('degrees', [-3.0, 8.0])
def test_slip_ends_the_scan_as_slipped(lasers, degrees):
    outcome = scan(lasers, slip=math.radians(degrees))
    assert outcome.code == 'SLIPPED'


def test_angles_without_images_are_taken_again():
    outcome = scan(stall=1.6)
    assert (outcome.code, outcome.detail) == ('OK', '')
    assert [view['retaken_as'] for view in outcome.completeness['views']] == [[2], []]


@pytest.mark.parametrize('seconds', [-3600.0, -0.2, 0.7, 3600.0])
@pytest.mark.parametrize('clock', ['all', 'camera', 'table'])
def test_clock_that_is_set_ends_the_scan(clock, seconds):
    outcome = scan(jump=seconds, clock=clock)
    assert outcome.code == 'CLOCK_JUMPED'


@pytest.mark.parametrize('clock', ['camera', 'table'])
def test_small_jump_of_one_clock_is_no_ok_without_a_word(clock):
    # too small for the stamps to tell: the part seems to turn by 13 degrees
    outcome = scan(jump=0.3, clock=clock)
    assert outcome.code != 'OK'
