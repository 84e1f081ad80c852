# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.scan.motion_check import MotionCheck


class Table:
    """A table that reports its position at 50 Hz, and the check of its move."""

    def __init__(self, start=0.0, target=1.0, velocity=0.5, **values):
        self.now, self.position = 100.0, start
        self.check = MotionCheck(
            start=start,
            target=target,
            velocity=velocity,
            tolerance=2e-3,
            clock=lambda: self.now,
            **values,
        )

    def turn(self, seconds, velocity, period=0.02):
        """Return (seconds, text) of the first report that is wrong, or None."""
        begin = self.now
        for _ in range(round(seconds / period)):
            self.now += period
            self.position += velocity * period
            text = self.check.update(self.position)
            if text:
                return self.now - begin, text
        return None


def test_move_as_planned_is_right():
    table = Table()
    assert table.turn(2.0, 0.5) is None
    # it stands at its target
    assert table.turn(5.0, 0.0) is None


def test_table_that_stops_short_is_found_within_a_second():
    table = Table()
    assert table.turn(1.0, 0.5) is None
    seconds, text = table.turn(5.0, 0.0)
    assert seconds < 1.0
    assert 'stands at 28.65 degrees' in text


def test_table_that_never_starts_is_found_in_time():
    seconds, _ = Table().turn(5.0, 0.0)
    assert seconds == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize('velocity', [3e-5, 1e-3])
def test_slow_move_does_not_stand(velocity):
    assert Table(velocity=velocity).turn(60.0, velocity) is None


def test_table_that_is_slower_than_commanded_does_not_stand():
    assert Table().turn(5.0, 0.05) is None


@pytest.mark.parametrize('velocity', [-0.2, 2.0])
def test_table_that_leaves_its_way_is_found(velocity):
    _, text = Table(target=0.5).turn(5.0, velocity)
    assert 'left its way' in text


def test_silence_of_the_driver_is_no_standstill():
    table = Table()
    assert table.turn(1.0, 0.5) is None
    table.now += 1.5
    assert table.turn(0.2, 0.0) is None
    assert table.turn(0.5, 0.5) is None


def test_table_that_has_not_begun_a_short_move_has_not_arrived():
    table = Table(target=1e-3)
    assert table.check.reach == pytest.approx(0.5e-3)
    assert abs(table.position - 1e-3) > table.check.reach
