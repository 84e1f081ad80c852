# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio
import math
from types import SimpleNamespace

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.profile_wait import ProfileWait
from ivfmc_ros.scan.table_reports import Standstill
from ivfmc_ros.stripe.stream import TUNING_IMAGES

PATIENCE_S = 20.0


class World:
    """
    A camera and a triangulator on a clock that only waiting moves.

    period : seconds between images, or a function of the second
    delay : seconds from an image to its profile, once there are enough images; None: no profiles
    lost : numbers of the images that became no profile
    """

    def __init__(self, period, delay=0.0, view=1, lost=()):
        self.period, self.delay, self.view, self.lost = period, delay, view, lost
        self.now = 0.0
        self.link = SimpleNamespace(info_stamps_ns=[], headers={})
        self.link.latest_profiles = lambda: list(self.link.headers.values())

    async def until(self, condition, seconds, what, code):
        deadline = self.now + seconds
        while not condition():
            if self.now > deadline:
                raise HelperError(code, what)
            self.now += 0.1
            self._advance()

    def _stamps(self):
        period = self.period if callable(self.period) else lambda second: self.period
        second = period(0.0)
        while second <= self.now + 1e-9:
            yield round(1e9 * second)
            second += period(second)

    def _advance(self):
        stamps = list(self._stamps())
        images = len(stamps)
        self.link.info_stamps_ns[:] = stamps
        if self.delay is not None and images >= TUNING_IMAGES:
            done = [stamp for stamp in stamps if 1e-9 * stamp + self.delay <= self.now]
            self.link.headers = {
                number: SimpleNamespace(view=self.view, stamp_ns=stamp, angle=0.0)
                for number, stamp in enumerate(done)
                if number not in self.lost
            }


def rate(world, enough=0.0):
    return asyncio.run(ProfileWait(world.link, world.until, PATIENCE_S).rate(1, enough))


@pytest.mark.parametrize('period', [1.0 / 30.0, 1.0, 4.0])
def test_rate_of_a_slow_camera_is_measured(period):
    # the images that resolve the settings take longer than the patience
    assert rate(World(period)) == pytest.approx(1.0 / period, rel=1e-6)


def test_one_lost_image_is_not_a_slow_camera():
    # of the first images that are there together
    assert rate(World(1.0 / 30.0, lost=[TUNING_IMAGES - 4])) == pytest.approx(30.0, rel=1e-6)


def test_low_rate_is_measured_again_as_long_as_it_rises():
    # a cell that was just started loads its libraries for ten seconds
    def period(second):
        return 0.5 if second < 10.0 else 0.1

    assert rate(World(period)) == pytest.approx(2.0)
    assert rate(World(period), enough=9.0) == pytest.approx(10.0)
    # a camera that is as slow as that for good costs one measurement more
    world = World(0.5)
    assert rate(world, enough=9.0) == pytest.approx(2.0)
    assert world.now < 0.5 * (TUNING_IMAGES + 9)


def test_camera_of_which_each_second_image_is_lost_is_slow():
    assert rate(World(0.1, lost=range(0, 1000, 2))) == pytest.approx(5.0, rel=1e-6)


def test_profiles_of_a_busy_computer_are_awaited():
    world = World(1.0, delay=19.0)
    here = Standstill(first_ns=60_000_000_000, after_ns=59_500_000_000)
    asyncio.run(ProfileWait(world.link, world.until, PATIENCE_S).profile_at(1, here))
    assert world.now == pytest.approx(79.0, abs=0.2)


@pytest.mark.parametrize('wrong', [{'delay': None}, {'view': 2}])
def test_images_without_profiles_of_the_view_are_no_progress_for_ever(wrong):
    world = World(1.0, **wrong)
    with pytest.raises(HelperError, match='first profiles of view 1'):
        rate(world)
    assert world.now == pytest.approx(TUNING_IMAGES + PATIENCE_S, abs=1.0)


def test_a_camera_that_sends_nothing_is_awaited_once():
    world = World(1e6)
    with pytest.raises(HelperError):
        rate(world)
    assert world.now == pytest.approx(PATIENCE_S, abs=0.2)


@pytest.mark.parametrize(
    ('angle', 'stamp_s', 'shown'),
    [
        (0.3, 5.1, True),
        # the report that the table arrived was lost, or forgotten by a node that was late
        (0.3, 4.5, True),
        (0.3 - 4.0 * math.pi, 4.5, True),
        (0.25, 4.5, False),
        # of the turn before
        (0.3, 3.9, False),
    ],
)
def test_profile_of_this_standstill_may_be_older_than_its_first_report(angle, stamp_s, shown):
    here = Standstill(position=0.3, first_ns=5_000_000_000, after_ns=4_000_000_000)
    assert here.shows(angle, round(1e9 * stamp_s)) is shown
