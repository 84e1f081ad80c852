# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio
import re
from types import SimpleNamespace

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.warm_up import WarmUp
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.stripe.stripe_motion import StripeRate

STEPS = make_plan(ScanRequest(motion='step'), ['left', 'right'], MotionLimits()).sweeps[0]
QUICK = make_plan(ScanRequest(), ['left', 'right'], MotionLimits(profile_rate=30.0)).sweeps[0]


def rate(px_per_s, u=1e-4, laser=1, seconds=20.0):
    return StripeRate(laser=laser, seconds=seconds, rate=px_per_s, u=u)


def waited(rates, sweep=STEPS, error=None):
    """Wait for the laser with index 1, whose diagnostics are the given ones in turn."""
    left = list(rates)

    async def until(condition, seconds, what, code):
        assert seconds == 30.0
        if error is not None:
            raise error
        while left:
            if condition():
                return
            left.pop(0)
        left.append(rates[-1])
        raise HelperError(code, f'timed out while waiting for {what}')

    diagnostics = SimpleNamespace(stripe_rate=lambda scan_id: left[0] if left else None)
    link = SimpleNamespace(diagnostics=diagnostics)
    text = asyncio.run(WarmUp(link, until, 'one', 30.0).wait('right', 1, sweep))
    return text, len(left)


def test_laser_that_slows_down_is_waited_for():
    text, left = waited([None, rate(0.1), rate(0.01), rate(0.001), rate(0.0)])
    assert text == ''
    assert left == 2


def test_rate_that_is_not_known_well_enough_is_no_rest():
    assert waited([rate(0.0, u=0.01), rate(0.0)])[1] == 1


def test_rate_of_another_laser_does_not_count():
    assert waited([rate(0.0, laser=0), rate(0.0)])[1] == 1


def test_quick_sweep_bears_a_faster_stripe():
    assert waited([rate(0.005), rate(0.0)], QUICK)[1] == 2
    assert waited([rate(0.005), rate(0.0)], STEPS)[1] == 1


@pytest.mark.parametrize(
    ('last', 'said'),
    [
        (
            rate(0.02),
            r'after 30 s the stripe of laser right moves by \+1.20 \+/- 0.01 pixels a min',
        ),
        (None, 'after 30 s nothing is known of laser right'),
        (rate(0.0, u=1.0, seconds=2.0), 'after 30 s laser right is known for 2.0 s only'),
    ],
)
def test_doubt_after_the_longest_time_is_said(last, said):
    assert re.search(said, waited([last])[0])


def test_other_faults_end_the_scan():
    with pytest.raises(HelperError) as caught:
        waited([None], error=HelperError('CAMERA_LOST', 'camera: silent'))
    assert caught.value.code == 'CAMERA_LOST'
