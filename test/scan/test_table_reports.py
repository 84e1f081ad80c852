# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the table stands, by the joint states that the orchestrator received."""

import math

import pytest

from ivfmc_ros.scan.table_reports import TableReports

TARGET = 0.5
MOVE_S, PERIOD_S = 1.0, 0.01
SECOND = 1_000_000_000


def run(table, seconds, lost=(0.0, 0.0), with_velocity=True):
    """Report a move and the standstill after it; some seconds of the reports are lost."""
    for number in range(round(seconds / PERIOD_S)):
        second = number * PERIOD_S
        if lost[0] <= second < lost[1]:
            continue
        velocity = TARGET / MOVE_S if second < MOVE_S else 0.0
        table.add(
            round((100.0 + second) * SECOND),
            TARGET * min(second / MOVE_S, 1.0),
            velocity if with_velocity else None,
        )


@pytest.mark.parametrize(
    ('seconds', 'lost'),
    # one after the other; many at once, of which the last are kept; the first ones lost, and the
    # last ones of the move
    [(1.2, (0.0, 0.0)), (4.0, (0.0, 0.0)), (2.5, (1.0, 2.2)), (2.5, (0.92, 2.2))],
)
@pytest.mark.parametrize('with_velocity', [True, False])
def test_profile_right_after_the_move_is_of_this_standstill(seconds, lost, with_velocity):
    table = TableReports()
    table.begin_move()
    run(table, seconds, lost, with_velocity)
    assert table.stands_at(TARGET, 1e-3)
    assert table.standstill.shows(TARGET, round((100.0 + MOVE_S + 0.05) * SECOND))
    assert not table.standstill.shows(0.9 * TARGET, round((100.0 + 0.9 * MOVE_S) * SECOND))


def test_profile_before_the_command_is_of_another_standstill():
    table = TableReports()
    run(table, 2.0)
    table.begin_move()
    assert not table.standstill.shows(TARGET, round(101.5 * SECOND))


def test_reports_before_the_command_are_no_standstill_after_it():
    table = TableReports()
    run(table, 2.0)
    assert table.stands_at(TARGET, 1e-3)
    table.begin_move()
    assert not table.stands_at(TARGET, 1e-3)


@pytest.mark.parametrize('rate', [50, 200, 1000])
def test_flickering_encoder_of_a_standing_table_is_no_velocity(rate):
    # one count of 17 bits: from report to report it is 0.01 rad/s at 200 Hz
    count, table, velocities = 2 * math.pi / 2**17, TableReports(), []
    for number in range(rate):
        table.add(number * SECOND // rate, count * (number % 2), None)
        velocities.append(abs(table.last.velocity))
    assert max(velocities[rate // 10 :]) < 5e-3


def test_velocity_of_a_moving_table_is_that_of_its_positions():
    table = TableReports()
    table.add(0, 0.0, None)
    assert math.isinf(table.last.velocity)
    for number in range(1, 20):
        table.add(number * SECOND // 100, 0.02 * number, None)
    assert table.last.velocity == pytest.approx(2.0)
