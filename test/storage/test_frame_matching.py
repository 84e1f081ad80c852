# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.frame_matching import Matcher
from ivfmc_ros.storage.frame_matching import MatchSettings

MS = 1_000_000
START = 1_790_000_000_000 * MS
LASERS = ['left', 'right']


def at(milliseconds):
    return START + milliseconds * MS


def a_matcher(**settings):
    return Matcher(LASERS, MatchSettings(**settings))


def on(matcher, milliseconds, name, now_s=0.0):
    states = {laser: float(laser == name) for laser in LASERS}
    return matcher.lasers(at(milliseconds), states, now_s)


def reasons(matcher):
    return [match.reason for match in matcher.ready()]


def test_a_picture_waits_until_table_and_lasers_are_known_past_it():
    matcher = a_matcher(exposure=0.02)
    matcher.picture(at(50), 'a', now_s=0.0)
    assert list(matcher.ready(0.1, 0.5)) == []
    matcher.table(at(0), 0.0, None, 0.1)
    on(matcher, 0, 'left', 0.1)
    assert list(matcher.ready(0.2, 0.5)) == []
    matcher.table(at(100), 0.2, None, 0.2)
    assert list(matcher.ready(0.2, 0.5)) == []
    on(matcher, 60, 'left', 0.2)
    assert list(matcher.ready(0.2, 0.5)) == []
    on(matcher, 70, 'left', 0.2)
    (match,) = matcher.ready(0.2, 0.5)
    assert (match.payload, match.laser, match.view, match.reason) == ('a', 0, 0, '')
    assert match.angle == pytest.approx(0.1, abs=1e-7)
    assert match.speed == pytest.approx(2.0)


def test_an_angle_is_one_that_a_message_does_not_round():
    matcher = a_matcher(always_on=True)
    matcher.table(at(0), 1000.1)
    matcher.picture(at(0), None)
    (match,) = matcher.ready()
    assert match.angle == float(np.float32(match.angle))
    # the whole turns of a table that has turned for days
    assert match.angle == pytest.approx(1000.1 - 159 * 2 * math.pi, abs=1e-6)


def test_who_waits_while_nothing_comes_is_judged_by_what_is_known():
    matcher = a_matcher()
    matcher.table(at(0), 0.0, 0.0, 0.0)
    on(matcher, 0, 'left')
    matcher.picture(at(100), 'near', now_s=1.0)
    matcher.picture(at(600), 'far', now_s=1.0)
    assert list(matcher.ready(1.4, 0.5)) == []
    found = list(matcher.ready(1.6, 0.5))
    assert [match.reason for match in found] == ['', 'no angle']


def test_a_late_report_prolongs_the_patience_that_it_deserves():
    matcher = a_matcher(always_on=True)
    matcher.picture(at(100), 'a', now_s=0.0)
    matcher.table(at(0), 0.0, None, now_s=0.4)
    assert list(matcher.ready(0.6, 0.5)) == []
    assert len(list(matcher.ready(1.0, 0.5))) == 1


@pytest.mark.parametrize('stamp_ns', [0, at(-200), at(3_600_000)])
def test_a_picture_of_another_time_holds_up_no_other(stamp_ns):
    matcher = a_matcher(always_on=True)
    matcher.table(at(0), 0.0, None, 0.0)
    matcher.picture(stamp_ns, 'odd', now_s=0.0)
    matcher.picture(at(50), 'good', now_s=0.0)
    found = []
    # the table is heard all the time
    for tick in range(12):
        matcher.table(at(100 * tick), 0.0, None, 0.1 * tick)
        found += matcher.ready(0.1 * tick, 0.5)
    assert {match.payload for match in found} == {'odd', 'good'}
    assert {match.payload: match.reason for match in found}['good'] == ''


@pytest.mark.parametrize(
    ('states', 'reason'),
    [
        ([(0, 'left')], ''),
        ([(0, 'none')], 'laser off'),
        ([(0, 'left'), (55, 'right')], 'laser changed'),
        ([(0, 'right'), (40, 'left')], ''),
        ([], 'lasers not known'),
    ],
)
def test_a_picture_needs_one_laser_all_the_time(states, reason):
    matcher = a_matcher(exposure=0.02)
    for stamp in (0, 100):
        matcher.table(at(stamp), 0.0)
    for stamp, name in states:
        on(matcher, stamp, name)
    matcher.picture(at(50), None)
    assert reasons(matcher) == [reason]


def darks(matcher):
    return [match.dark and match.dark.payload for match in matcher.ready() if not match.reason]


def test_picture_gets_the_dark_one_of_its_stand():
    matcher = a_matcher(dark=True, motion='step', settle=0.0)
    for stamp, angle in ((0, 0.0), (300, 0.0), (400, 0.5), (700, 0.5)):
        matcher.table(at(stamp), angle)
    for stamp, name in ((0, 'none'), (100, 'left'), (340, 'none'), (550, 'left')):
        on(matcher, stamp, name)
    for stamp in (20, 150, 600):
        matcher.picture(at(stamp), f'picture at {stamp}')
    # the stand at 0.5 rad has none of its own, and must not get that of 0 rad
    assert darks(matcher) == ['picture at 20', None]


def test_dark_picture_of_a_moving_table_is_none():
    matcher = a_matcher(dark=True, motion='step', settle=0.05)
    for stamp, angle in ((0, 0.0), (100, 0.1), (400, 0.1)):
        matcher.table(at(stamp), angle)
    for stamp, name in ((0, 'none'), (200, 'left')):
        on(matcher, stamp, name)
    for stamp in (90, 300):
        matcher.picture(at(stamp), f'picture at {stamp}')
    assert darks(matcher) == [None]


def test_two_lasers_at_once_are_none():
    matcher = a_matcher()
    matcher.table(at(50), 0.0)
    matcher.lasers(at(0), {'left': 1.0, 'right': 1.0})
    matcher.picture(at(50), None)
    assert reasons(matcher) == ['two lasers on']


def test_views_are_numbered_as_the_settings_say_when_a_picture_comes():
    matcher = a_matcher(views=(-1, 5))
    matcher.table(at(0), 0.0)
    on(matcher, 0, 'left')
    on(matcher, 100, 'right')
    matcher.table(at(200), 0.0)
    matcher.picture(at(50), None)
    matcher.picture(at(150), None)
    matcher.settings = MatchSettings(views=(0, 6))
    found = list(matcher.ready())
    assert [(match.reason, match.view) for match in found] == [
        ('laser not measured', 0),
        ('', 5),
    ]


def test_in_steps_a_table_must_stand_from_before_to_the_end_of_the_exposure():
    matcher = a_matcher(motion='step', always_on=True, settle=0.05, exposure=0.02)
    # stands until 100, turns to 0.1 at 200, stands
    for stamp in range(0, 401, 10):
        matcher.table(at(stamp), 0.001 * min(max(stamp - 100, 0), 100))
    for stamp in (60, 70, 90, 150, 220, 260, 300):
        matcher.picture(at(stamp), stamp)
    assert reasons(matcher) == [
        '',
        'angle measured already',
        'table moving',
        'table moving',
        'table moving',
        '',
        'angle measured already',
    ]


def test_time_that_jumps_back_makes_a_table_forgotten():
    matcher = a_matcher(always_on=True)
    assert matcher.table(at(100_000), 1.0)
    assert matcher.table(at(99_900), 0.9)
    assert not matcher.table(at(0), 5.0)
    matcher.picture(at(100_000), 'old')
    matcher.picture(at(0), 'new')
    assert [(m.payload, m.reason) for m in matcher.ready()] == [('new', ''), ('old', 'no angle')]


def test_reports_out_of_order_and_modulo_a_turn_are_put_right():
    matcher = a_matcher(always_on=True)
    for stamp, position in ((0, 6.2), (200, 0.4), (100, 0.02)):
        matcher.table(at(stamp), position)
    matcher.picture(at(150), None)
    (match,) = matcher.ready()
    assert match.angle == pytest.approx(0.21, abs=1e-6)


def test_the_oldest_picture_is_given_up_first():
    matcher = a_matcher()
    for stamp in (30, 10, 20):
        matcher.picture(at(stamp), stamp)
    assert matcher.drop_oldest().payload == 10
    assert len(matcher) == 2


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('motion', 'hop'),
        ('exposure', -0.1),
        ('settle', math.nan),
        ('min_step', 4.0),
        ('views', (-2,)),
        ('views', (70_000,)),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name.rstrip('s')):
        MatchSettings(**{name: value})
