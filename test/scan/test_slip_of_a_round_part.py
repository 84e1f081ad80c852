# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Slips of the demo part, most of which is round, in rendered scans that begin at any table angle.

Where a sweep begins is where one laser sees the part twice, and decides what the check for lost
steps can know.
"""

import asyncio
from dataclasses import replace
from functools import cache
import math

import numpy as np
import pytest
from support.erring_table import NOISE
from support.erring_table import noisy
from support.erring_table import Sweep
from support.rendered_stripes import rendered_stripes
from support.small_cell import small_cell

from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.simulation.parts.solids import demo_part

pytest.importorskip('rclpy')
from support.rendered_cell import Fault
from support.rendered_cell import LASERS
from support.rendered_cell import RenderedCell

STEPS, RATE = 200, 15.0


@cache
def turn():
    angles = 2.0 * np.pi * np.arange(STEPS) / STEPS
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    return rendered_stripes(small_cell(), demo_part(), sweeps, 31)


def scan(seed, lasers, degrees=0.0, share=0.5):
    """Scan from the position of a seed; the table slips after a share of the scan."""
    rng = np.random.default_rng((5, seed))
    lines = [
        [replace(noisy(one, rng), sigma=np.hypot(one.sigma, NOISE)) for one in stripes]
        for stripes in turn()
    ]
    request = ScanRequest(profiles=STEPS, lasers=LASERS[:lasers])
    motion = MotionLimits(profile_rate=RATE)
    plan = make_plan(request, LASERS, motion, rng.uniform(0.0, 2.0 * np.pi))
    at = share * lasers * STEPS / RATE
    fault = Fault(at=at, slip=math.radians(degrees)) if degrees else Fault()
    tools = RenderedCell(small_cell(), lines, plan, motion, fault, seed)
    return asyncio.run(run_job(StateMachine(), plan, motion, tools))


@pytest.mark.parametrize(('seed', 'lasers'), [(0, 1), (5, 1), (109, 1), (1, 2), (11, 2)])
def test_good_scan_that_begins_anywhere_is_no_slip(seed, lasers):
    # surfels of top and round faces, which no rotation moves, were counted: -8.6 and -31.7 degrees
    outcome = scan(seed, lasers)
    assert outcome.code == 'OK'
    assert 'differ by more than their noise' not in outcome.detail


@pytest.mark.parametrize(
    ('seed', 'lasers', 'degrees', 'share'),
    [(1, 1, -5.11, 0.32), (4, 1, -1.78, 0.66), (100, 2, 9.34, 0.25), (109, 2, 10.32, 0.43)],
)
def test_slip_that_the_round_faces_do_not_show_is_found(seed, lasers, degrees, share):
    outcome = scan(seed, lasers, degrees, share)
    assert outcome.code == 'SLIPPED'
    found = float(outcome.detail.partition(' by ')[2].split()[0])
    assert found == pytest.approx(degrees, abs=0.3)
