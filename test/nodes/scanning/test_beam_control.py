# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio
from types import SimpleNamespace

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.beam_control import BeamControl

SWITCHED_OFF_NS = 1_000


class FakeCell:
    """A node and its link: lasers went off at a stamp, an image at ``dark_ns`` shows none."""

    def __init__(self, dark_ns=0, publishers=1, stuck=False):
        self.warnings = []
        self.publishers, self.stuck = publishers, stuck
        self.headers = {0: None}
        self.dark_since_ns = SWITCHED_OFF_NS
        self.diagnostics = SimpleNamespace(dark_ns=lambda scan_id: dark_ns)
        self.waits = 0

    def count_publishers(self, topic):
        assert topic == 'laser_states'
        return self.publishers

    def get_logger(self):
        return SimpleNamespace(warning=self.warnings.append)

    async def until(self, condition, seconds, what, code):
        self.waits += 1
        if self.stuck:
            raise HelperError('LASER_STUCK', 'laser left shines')
        if not condition():
            raise HelperError(code, f'timed out while waiting for {what}')


def check_off(cell):
    beam = BeamControl(cell, cell, cell.until, 2.0, 'one')
    asyncio.run(beam.check_off())
    return cell


def test_image_after_the_switch_that_shows_no_laser_ends_the_wait():
    assert check_off(FakeCell(dark_ns=SWITCHED_OFF_NS + 5)).warnings == []


def test_image_from_before_the_switch_does_not_count():
    [warning] = check_off(FakeCell(dark_ns=SWITCHED_OFF_NS - 5)).warnings
    assert 'whether the lasers are off was not seen' in warning


def test_laser_that_shines_ends_the_scan():
    with pytest.raises(HelperError) as caught:
        check_off(FakeCell(stuck=True))
    assert caught.value.code == 'LASER_STUCK'


def test_lasers_that_are_not_reported_are_not_awaited():
    assert check_off(FakeCell(publishers=0)).waits == 0
