# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.frame_matching import NOT_MEASURED
from ivfmc_ros.storage.matching.frame_matching import SAME_POSITION

MS = 1_000_000
START = 1_790_000_000_000 * MS
LASERS = ['left', 'right']


def at(milliseconds):
    return START + milliseconds * MS


def a_matcher(**settings):
    return FrameMatcher(LASERS, MatchSettings(**settings))


def on(matcher, milliseconds, name, now_s=0.0):
    states = {laser: float(laser == name) for laser in LASERS}
    return matcher.add_laser_states(at(milliseconds), states, now_s)


def reasons(matcher):
    return [match.reason for match in matcher.pop_matches()]


def test_image_waits_for_table_and_lasers_past_its_exposure():
    matcher = a_matcher(exposure=0.02)
    matcher.add_image(at(50), 'a', now_s=0.0)
    assert list(matcher.pop_matches(0.1, 0.5)) == []
    matcher.add_table_position(at(0), 0.0, None, 0.1)
    on(matcher, 0, 'left', 0.1)
    assert list(matcher.pop_matches(0.2, 0.5)) == []
    matcher.add_table_position(at(100), 0.2, None, 0.2)
    assert list(matcher.pop_matches(0.2, 0.5)) == []
    on(matcher, 60, 'left', 0.2)
    assert list(matcher.pop_matches(0.2, 0.5)) == []
    on(matcher, 70, 'left', 0.2)
    (match,) = matcher.pop_matches(0.2, 0.5)
    assert (match.payload, match.laser, match.view, match.reason) == ('a', 0, 0, '')
    assert match.angle == pytest.approx(0.1, abs=1e-7)
    assert match.speed == pytest.approx(2.0)


def test_angle_is_exact_in_single_precision():
    matcher = a_matcher(always_on=True)
    matcher.add_table_position(at(0), 1000.1)
    matcher.add_image(at(0), None)
    (match,) = matcher.pop_matches()
    assert match.angle == float(np.float32(match.angle))
    # whole turns are subtracted
    assert match.angle == pytest.approx(1000.1 - 159 * 2 * math.pi, abs=1e-6)


def test_image_is_matched_with_known_states_after_the_timeout():
    matcher = a_matcher()
    matcher.add_table_position(at(0), 0.0, 0.0, 0.0)
    on(matcher, 0, 'left')
    matcher.add_image(at(100), 'near', now_s=1.0)
    matcher.add_image(at(600), 'far', now_s=1.0)
    assert list(matcher.pop_matches(1.4, 0.5)) == []
    found = list(matcher.pop_matches(1.6, 0.5))
    assert [match.reason for match in found] == ['', 'no angle']


def test_late_state_restarts_the_timeout():
    matcher = a_matcher(always_on=True)
    matcher.add_image(at(100), 'a', now_s=0.0)
    matcher.add_table_position(at(0), 0.0, None, now_s=0.4)
    assert list(matcher.pop_matches(0.6, 0.5)) == []
    assert len(list(matcher.pop_matches(1.0, 0.5))) == 1


@pytest.mark.parametrize('stamp_ns', [0, at(-200), at(3_600_000)])
def test_image_of_another_clock_blocks_no_other(stamp_ns):
    matcher = a_matcher(always_on=True)
    matcher.add_table_position(at(0), 0.0, None, 0.0)
    matcher.add_image(stamp_ns, 'odd', now_s=0.0)
    matcher.add_image(at(50), 'good', now_s=0.0)
    found = []
    # table positions arrive all the time
    for tick in range(12):
        matcher.add_table_position(at(100 * tick), 0.0, None, 0.1 * tick)
        found += matcher.pop_matches(0.1 * tick, 0.5)
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
def test_image_needs_one_laser_during_its_exposure(states, reason):
    matcher = a_matcher(exposure=0.02)
    for stamp in (0, 100):
        matcher.add_table_position(at(stamp), 0.0)
    for stamp, name in states:
        on(matcher, stamp, name)
    matcher.add_image(at(50), None)
    assert reasons(matcher) == [reason]


def dark_payloads(matcher):
    used = [match for match in matcher.pop_matches() if not match.reason]
    return [match.dark and match.dark.payload for match in used]


def test_image_gets_the_dark_frame_of_its_position():
    matcher = a_matcher(dark=True, motion='step', settle=0.0)
    for stamp, angle in ((0, 0.0), (300, 0.0), (400, 0.5), (700, 0.5)):
        matcher.add_table_position(at(stamp), angle)
    for stamp, name in ((0, 'none'), (100, 'left'), (340, 'none'), (550, 'left')):
        on(matcher, stamp, name)
    for stamp in (20, 150, 600):
        matcher.add_image(at(stamp), f'image at {stamp}')
    # there is no dark frame at 0.5 rad, and that of 0 rad must not be used
    assert dark_payloads(matcher) == ['image at 20', None]


def test_dark_image_of_a_moving_table_is_not_used():
    matcher = a_matcher(dark=True, motion='step', settle=0.05)
    for stamp, angle in ((0, 0.0), (100, 0.1), (400, 0.1)):
        matcher.add_table_position(at(stamp), angle)
    for stamp, name in ((0, 'none'), (200, 'left')):
        on(matcher, stamp, name)
    for stamp in (90, 300):
        matcher.add_image(at(stamp), f'image at {stamp}')
    assert dark_payloads(matcher) == [None]


def test_two_lasers_at_once_are_none():
    matcher = a_matcher()
    matcher.add_table_position(at(50), 0.0)
    matcher.add_laser_states(at(0), {'left': 1.0, 'right': 1.0})
    matcher.add_image(at(50), None)
    assert reasons(matcher) == ['two lasers on']


def test_settings_at_the_arrival_of_an_image_apply():
    matcher = a_matcher(views=(-1, 5))
    matcher.add_table_position(at(0), 0.0)
    on(matcher, 0, 'left')
    on(matcher, 100, 'right')
    matcher.add_table_position(at(200), 0.0)
    matcher.add_image(at(50), None)
    matcher.add_image(at(150), None)
    matcher.settings = MatchSettings(views=(0, 6))
    found = list(matcher.pop_matches())
    assert [(match.reason, match.view) for match in found] == [
        ('laser not measured', 0),
        ('', 5),
    ]


def test_step_motion_needs_standstill_until_the_end_of_the_exposure():
    matcher = a_matcher(motion='step', always_on=True, settle=0.05, exposure=0.02)
    # standstill until 100 ms, motion to 0.1 rad at 200 ms, standstill
    for stamp in range(0, 401, 10):
        matcher.add_table_position(at(stamp), 0.001 * min(max(stamp - 100, 0), 100))
    for stamp in (60, 70, 90, 150, 220, 260, 300):
        matcher.add_image(at(stamp), stamp)
    assert reasons(matcher) == [
        '',
        'angle measured already',
        'table moving',
        'table moving',
        'table moving',
        '',
        'angle measured already',
    ]


def test_clock_that_jumps_back_deletes_the_positions():
    matcher = a_matcher(always_on=True)
    assert matcher.add_table_position(at(100_000), 1.0)
    assert matcher.add_table_position(at(99_900), 0.9)
    assert not matcher.add_table_position(at(0), 5.0)
    matcher.add_image(at(100_000), 'old')
    matcher.add_image(at(0), 'new')
    found = [(match.payload, match.reason) for match in matcher.pop_matches()]
    assert found == [('new', ''), ('old', 'no angle')]


def test_positions_out_of_order_and_modulo_a_turn_are_corrected():
    matcher = a_matcher(always_on=True)
    for stamp, position in ((0, 6.2), (200, 0.4), (100, 0.02)):
        matcher.add_table_position(at(stamp), position)
    matcher.add_image(at(150), None)
    (match,) = matcher.pop_matches()
    assert match.angle == pytest.approx(0.21, abs=1e-6)


def test_oldest_image_is_dropped_first():
    matcher = a_matcher()
    for stamp in (30, 10, 20):
        matcher.add_image(at(stamp), stamp)
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
def test_invalid_settings_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name.rstrip('s')):
        MatchSettings(**{name: value})


def bracketed(matcher):
    matches = list(matcher.pop_matches())
    used = [match for match in matches if not match.reason]
    return [(match.payload, [other.payload for other in match.bracket]) for match in used], [
        match.reason for match in matches
    ]


@pytest.mark.parametrize('motion', ['continuous', 'step'])
def test_exposures_of_one_position_make_one_match(motion):
    matcher = a_matcher(exposures=3, motion=motion, settle=0.0)
    for stamp, angle in ((0, 0.0), (300, 0.0), (400, 0.5), (700, 0.5), (800, 1.0), (1100, 1.0)):
        matcher.add_table_position(at(stamp), angle)
    on(matcher, 0, 'left')
    on(matcher, 1100, 'left')
    # of the second position one exposure is missing
    for stamp in (50, 100, 150, 450, 500, 850, 900, 950):
        matcher.add_image(at(stamp), stamp)
    used, found = bracketed(matcher)
    assert used == [(150, [50, 100]), (950, [850, 900])]
    assert found.count('one of several exposures') == 6


def test_exposures_do_not_mix_with_dark_frames():
    with pytest.raises(ParameterError, match='exposures'):
        MatchSettings(exposures=2, dark=True)
    with pytest.raises(ParameterError, match='exposures'):
        MatchSettings(exposures=0)


@pytest.mark.parametrize(('delay', 'reason'), [(0.0, ''), (0.05, 'laser changed')])
def test_stamp_of_the_arrival_is_not_taken_for_the_exposure(delay, reason):
    # exposed with the left laser on, stamped when the right one was
    matcher = a_matcher(exposure=0.005, stamp_delay=delay)
    for milliseconds in (0, 200):
        matcher.add_table_position(at(milliseconds), 0.0)
    on(matcher, 0, 'left')
    on(matcher, 60, 'right')
    on(matcher, 200, 'right')
    matcher.add_image(at(100), None)
    assert reasons(matcher) == [reason]


@pytest.mark.parametrize(('delay', 'reason'), [(0.0, ''), (0.1, 'table moving')])
def test_table_has_to_stand_before_the_stamp_by_the_delay(delay, reason):
    matcher = a_matcher(motion='step', settle=0.1, exposure=0.005, stamp_delay=delay)
    on(matcher, 0, 'left')
    for milliseconds in range(0, 400, 10):
        matcher.add_table_position(at(milliseconds), min(milliseconds, 100) * 0.001)
    on(matcher, 390, 'left')
    matcher.add_image(at(250), None)
    assert reasons(matcher) == [reason]


def test_late_stamps_do_not_go_with_dark_frames():
    with pytest.raises(ParameterError, match='stamp_delay'):
        MatchSettings(stamp_delay=0.1, dark=True)


@pytest.mark.parametrize(
    ('settings', 'reason'),
    [
        ({'views': (-1, -1)}, NOT_MEASURED),
        ({'motion': 'step', 'settle': 0.0}, SAME_POSITION),
    ],
)
def test_image_of_a_known_laser_that_is_not_used_has_laser_and_angle(settings, reason):
    matcher = a_matcher(exposure=0.01, **settings)
    for milliseconds in range(0, 600, 20):
        matcher.add_table_position(at(milliseconds), 7.0)
        on(matcher, milliseconds, 'right')
    matcher.add_image(at(100), 'first')
    matcher.add_image(at(200), 'second')
    match = list(matcher.pop_matches())[-1]
    assert (match.payload, match.reason, match.laser) == ('second', reason, 1)
    assert math.remainder(match.angle - 7.0, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
