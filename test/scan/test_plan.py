# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import math

import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import require_steps
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.request import ScanRequest

LASERS = ('left', 'right')
TURN = 2.0 * math.pi


def plan(position=0.0, motion_of_table=None, **values):
    request = ScanRequest(**values)
    return make_plan(request, LASERS, motion_of_table or MotionLimits(), position)


def test_lasers_alternate_at_every_stop():
    made = plan(motion='step', profiles=4)
    (sweep,) = made.sweeps
    assert sweep.views == (0, 1)
    assert sweep.lasers == LASERS
    assert sweep.velocity == 0.0
    assert sweep.angles() == pytest.approx([0.0, TURN / 4, TURN / 2, 3 * TURN / 4])
    assert (made.views, made.profiles) == (2, 8)


def test_each_laser_takes_a_sweep_in_continuous_motion():
    made = plan(profiles=200)
    assert [sweep.views for sweep in made.sweeps] == [(0, -1), (-1, 1)]
    assert [sweep.lasers for sweep in made.sweeps] == [('left',), ('right',)]
    assert made.sweeps[0].velocity == pytest.approx(TURN / 200 * 10.0)


@pytest.mark.parametrize(
    ('motion', 'views'),
    [('continuous', [(0, -1), (1, -1), (-1, 2), (-1, 3)]), ('step', [(0, 1), (2, 3)])],
)
def test_every_exposure_is_a_sweep_of_its_own(motion, views):
    made = plan(motion=motion, exposures=(0.002, 0.008))
    assert [sweep.views for sweep in made.sweeps] == views
    assert [sweep.exposure for sweep in made.sweeps] == [0.002, 0.008] * (len(views) // 2)
    assert [sweep.number for sweep in made.sweeps] == list(range(len(views)))


@pytest.mark.parametrize('views', [1, 3])
def test_sweeps_of_several_exposures_cover_the_same_turn(views):
    made = plan(lasers=('right',), views=views, exposures=(0.002, 0.008), overlap=0.1)
    for first, second in zip(made.sweeps[::2], made.sweeps[1::2], strict=True):
        assert (first.exposure, second.exposure) == (0.002, 0.008)
        assert second.start > first.start
    ends = [sweep.closing > 0 for sweep in made.sweeps]
    # the end of the last sweep is compared with the beginning of the turn
    assert ends == [False] * (2 * views - 1) + [True]
    for sweeps in (made.sweeps[::2], made.sweeps[1::2]):
        begins = [(sweep.start - sweeps[0].start) % TURN for sweep in sweeps]
        assert begins == pytest.approx([part * TURN / views for part in range(views)])


def test_one_laser_keeps_its_place_in_the_cell():
    assert [sweep.views for sweep in plan(lasers=('right',)).sweeps] == [(-1, 0)]


def test_sweeps_of_a_turn_overlap():
    made = plan(motion='step', views=3, overlap=0.2, profiles=10)
    assert [sweep.views for sweep in made.sweeps] == [(0, 1), (2, 3), (4, 5)]
    assert all(sweep.span == pytest.approx(TURN / 3 + 0.2) for sweep in made.sweeps)


def test_single_sweep_extends_beyond_the_turn():
    assert plan(overlap=0.3).sweeps[0].span == pytest.approx(TURN + 0.3)


@pytest.mark.parametrize('motion', ['step', 'continuous'])
@pytest.mark.parametrize('views', [1, 3])
def test_last_sweep_of_one_laser_repeats_the_beginning_of_the_turn(motion, views):
    *before, last = plan(motion=motion, views=views, profiles=60, lasers=('left',)).sweeps
    step = TURN / views / 60
    assert last.closing == math.ceil(math.radians(15.0) / step)
    assert last.profiles == 60 + last.closing
    assert last.span == pytest.approx(TURN / views + last.closing * step)
    assert last.velocity == pytest.approx(step * 10.0 if motion == 'continuous' else 0.0)
    for sweep in before:
        assert (sweep.profiles, sweep.closing) == (60, 0)
        assert sweep.span == pytest.approx(TURN / views)


def test_closure_counts_the_overlap_and_can_be_off():
    (sweep,) = plan(lasers=('left',), closure=0.0).sweeps
    assert (sweep.span, sweep.profiles) == (pytest.approx(TURN), 200)
    (sweep,) = plan(lasers=('left',), overlap=0.3).sweeps
    assert (sweep.span, sweep.profiles) == (pytest.approx(TURN + 0.3), 200)
    (sweep,) = plan(lasers=('left',), overlap=0.2, profiles=100).sweeps
    assert TURN + math.radians(15.0) <= sweep.span < TURN + math.radians(15.0) + TURN / 90


def test_two_lasers_see_a_slip_without_closure():
    assert all(sweep.span == pytest.approx(TURN) for sweep in plan().sweeps)
    assert all(sweep.closing == 0 for sweep in plan().sweeps)


@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_table_turns_in_positive_direction_only(motion):
    table = MotionLimits()
    place = 17.3
    for sweep in plan(place, table, motion=motion, views=3, overlap=0.2).sweeps:
        begin = sweep.start - sweep.lead_angle(table)
        assert place - 2e-3 <= begin <= place + TURN
        place = sweep.start + sweep.span


@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_sweeps_of_a_laser_share_a_turn(motion):
    sweeps = plan(17.3, motion=motion, views=3, overlap=0.2).sweeps
    for laser in LASERS:
        first, *others = [sweep.start for sweep in sweeps if laser in sweep.lasers]
        for part, start in enumerate(others, 1):
            assert (start - first - part * TURN / 3) / TURN == pytest.approx(
                round((start - first - part * TURN / 3) / TURN)
            )


@pytest.mark.parametrize('lasers', [('left',), LASERS])
def test_continuous_sweep_begins_where_the_table_stands(lasers):
    # a move to an agreed start took 3 s of each sweep
    table = MotionLimits()
    place = 17.3
    for sweep in plan(place, table, lasers=lasers).sweeps:
        assert sweep.begin(table) == pytest.approx(place)
        place = sweep.end(table)


def test_constant_speed_is_reached_before_the_first_profile():
    table = MotionLimits(acceleration=2.0, lead_time=0.5)
    sweep = plan(motion_of_table=table).sweeps[0]
    ramp = sweep.velocity**2 / (2 * table.acceleration)
    assert sweep.lead_angle(table) == pytest.approx(ramp + 0.5 * sweep.velocity)


@pytest.mark.parametrize(('rate', 'seconds'), [(10.0, 0.4), (30.0, 0.2), (1.0, 3.1)])
def test_lead_has_the_profiles_by_which_the_end_of_the_ramp_is_found(rate, seconds):
    assert MotionLimits(profile_rate=rate).lead_seconds == pytest.approx(seconds)


def test_negative_lead_is_refused():
    with pytest.raises(ParameterError, match='lead_time'):
        MotionLimits(lead_time=-0.1)


def test_unknown_laser_is_refused():
    with pytest.raises(ParameterError, match=r"'top' is not in the cell; it has left, right"):
        plan(lasers=('top',))


def test_sweep_faster_than_the_table_is_refused():
    with pytest.raises(ParameterError, match='request 42 or more'):
        plan(profiles=10)


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, math.inf])
def test_motion_limit_that_is_not_positive_is_refused(value):
    with pytest.raises(ParameterError, match='velocity'):
        MotionLimits(velocity=value)


def test_table_turns_slower_for_a_slow_camera():
    sweep = plan(profiles=200).sweeps[0]
    # the rate of a camera that its computer limits varies: one that falls by a tenth loses nothing
    assert sweep.limited_velocity(5.0) <= TURN / 200 * 4.5
    assert sweep.limited_velocity(5.0) >= TURN / 200 * 4.0
    assert sweep.limited_velocity(9.5) == pytest.approx(TURN / 200 * 9.5)
    assert sweep.limited_velocity(20.0) == sweep.velocity


def test_short_move_is_planned_without_reaching_the_velocity():
    # 200 stops a turn: 14 ms more than needed at each, and the driver keeps the duration
    table = MotionLimits(velocity=1.5, acceleration=6.0)
    step = TURN / 200
    assert table.seconds(step, 1.5) == pytest.approx(2.0 * math.sqrt(step / 6.0))
    assert table.seconds(-step, 1.5) < 0.15
    # continuous where the ramps meet
    meeting = 1.5**2 / 6.0
    assert table.seconds(meeting, 1.5) == pytest.approx(0.5)
    assert table.seconds(meeting + 1.5, 1.5) == pytest.approx(1.5)
    assert table.seconds(0.0, 1.5) == 0.0


def test_steps_below_the_tolerance_are_refused_with_the_greatest_number():
    made = plan(motion='step', profiles=3142)
    with pytest.raises(ParameterError, match=r'profiles: 3142 .* request 3141 or fewer'):
        require_steps(made, 2e-3, 'position_tolerance')
    require_steps(plan(motion='step', profiles=3141), 2e-3, 'position_tolerance')
    closing = plan(motion='step', profiles=3142, lasers=('left',))
    with pytest.raises(ParameterError, match=r'request 3141 or fewer'):
        require_steps(closing, 2e-3, 'position_tolerance')
    require_steps(plan(profiles=20000), 2e-3, 'position_tolerance')
    require_steps(made, 0.0, 'min_step')


def triggered(step, motion_of_table=None, **values):
    request = ScanRequest(**values)
    return make_plan(request, LASERS, motion_of_table or MotionLimits(), trigger_step=step)


def test_trigger_determines_the_number_of_profiles_and_the_velocity():
    step = math.radians(0.8)
    made = triggered(step, profiles=200)
    for sweep in made.sweeps:
        assert sweep.profiles == 450
        assert sweep.velocity == pytest.approx(step * 10.0)
        assert step * 5.5 < sweep.limited_velocity(7.0) < step * 6.5


def test_profiles_that_the_trigger_does_not_give_are_refused():
    assert triggered(math.radians(0.8), profiles=450).sweeps[0].profiles == 450
    with pytest.raises(ParameterError, match='the trigger gives 450'):
        triggered(math.radians(0.8), profiles=451)
    with pytest.raises(ParameterError, match='request 225 or fewer'):
        triggered(math.radians(0.8), profiles=300, views=2)


def test_triggered_table_is_never_faster_than_its_limit_or_the_camera():
    limits = MotionLimits(profile_rate=100.0, velocity=0.5)
    (first, *_) = triggered(0.02, limits, profiles=100).sweeps
    assert first.velocity == 0.5
    # without a trigger so few profiles need a faster table
    with pytest.raises(ParameterError, match=r'the limit is 0\.5'):
        plan(profiles=100, motion_of_table=limits)


def test_step_motion_needs_no_trigger():
    (sweep,) = triggered(0.02, motion='step', profiles=4).sweeps
    assert (sweep.profiles, sweep.trigger_step) == (4, 0.0)


def test_closure_of_a_triggered_sweep_counts_in_trigger_steps():
    (sweep,) = triggered(math.radians(0.8), profiles=100, lasers=('left',)).sweeps
    assert sweep.profiles == 450 + sweep.closing
    assert sweep.closing == math.ceil(15.0 / 0.8)
    assert sweep.span == pytest.approx(math.radians(0.8) * sweep.profiles)


@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_sweep_is_the_same_after_it_was_stored(motion):
    for sweep in plan(2.0, motion=motion, views=2, lasers=('left',), overlap=0.2).sweeps:
        stored = json.loads(json.dumps(sweep.as_dict()))
        assert Sweep.from_dict(stored) == sweep


@pytest.mark.parametrize(
    'change',
    [{'start': math.nan}, {'span': '1'}, {'profiles': 0}, {'views': [-1, -1]}, {'lasers': 3},
     {'unknown': 1}, {'span': -1.0},
     {'exposure': -1.0}, {'exposure': math.nan}],
)  # fmt: skip
def test_stored_values_that_are_no_sweep_are_refused(change):
    sweep = plan(lasers=('left',)).sweeps[0]
    with pytest.raises(ParameterError, match='sweep: '):
        Sweep.from_dict({**sweep.as_dict(), **change})
