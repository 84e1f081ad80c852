# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import math

import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.completeness import Completeness
from ivfmc_ros.scan.plan import after_position
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.storage.messages.profile_header import ProfileHeader

MOTION = MotionLimits()
TURN = 2.0 * math.pi
PERIOD_NS = 100_000_000


class Scan:
    """A scan of which the images of some angles, degrees, do not come."""

    def __init__(self, position=0.0, max_spacing=0.0, **values):
        values = {'profiles': 200, 'lasers': ('left',), 'closure': 0.0, **values}
        self.plan = make_plan(ScanRequest(**values), ('left', 'right'), MOTION, position)
        limits = CompletenessLimits(max_spacing=max_spacing)
        self.completeness = Completeness(self.plan, MOTION, limits)
        self.radius = lambda angle: 0.0
        self.headers = {}
        self.infos = []
        self.stamp_ns = 1_700_000_000_000_000_000
        self.turns = None

    def take(self, sweep, lost=(), points=50):
        """Take a sweep; ``lost`` is a range of degrees from its planned start without images."""
        self.completeness.begin(sweep)
        step = sweep.span / sweep.profiles
        lead = sweep.lead_angle(MOTION)
        count = math.ceil((sweep.span + 2.0 * lead) / step) if sweep.velocity else sweep.profiles
        for view in (view for view in sweep.views if view >= 0):
            begin = sweep.start - lead
            for index in [*([0] * 6 if lead else []), *range(count)]:
                self.stamp_ns += PERIOD_NS
                angle = begin + index * step
                if lost and lost[0] <= math.degrees(angle - sweep.start) < lost[1]:
                    continue
                self.add(view, angle, points)

    def add(self, view, angle, points):
        if self.turns is None:
            self.turns = TURN * round(angle / TURN)
        seq = len(self.headers)
        self.infos.append(self.stamp_ns)
        self.headers[seq] = ProfileHeader(
            seq=seq, view=view, laser=0, angle=angle - self.turns, points=points,
            stamp_ns=self.stamp_ns, reach=self.radius(angle),
        )  # fmt: skip

    def coverage(self, registered=()):
        return self.completeness.coverage(self.headers, registered)


@pytest.mark.parametrize('motion', ['step', 'continuous'])
@pytest.mark.parametrize('position', [0.0, 40.0])
@pytest.mark.parametrize('views', [1, 3])
def test_scan_as_planned_is_complete(motion, position, views):
    scan = Scan(position, motion=motion, views=views, overlap=0.2, lasers=('left', 'right'))
    for sweep in scan.plan.sweeps:
        scan.take(sweep)
        assert scan.completeness.retakes(sweep, scan.headers) == []
    found = scan.coverage()
    assert [view.why for view in found] == [''] * (2 * views)
    assert all(view.profiles >= view.planned for view in found)
    assert sorted(view.view for view in found) == list(range(2 * views))


def test_two_lost_images_in_a_row_are_no_hole():
    scan = Scan()
    scan.take(scan.plan.sweeps[0], lost=(90.0, 93.6))
    (view,) = scan.coverage()
    assert view.why == ''
    assert math.degrees(view.largest_gap) == pytest.approx(5.4, abs=0.1)


@pytest.mark.parametrize('lost', [(90.0, 184.0), (-10.0, 30.0), (330.0, 400.0)])
def test_camera_that_stood_still_makes_the_scan_incomplete_with_its_angles(lost):
    scan = Scan(position=20.0)
    scan.take(scan.plan.sweeps[0], lost=lost)
    (view,) = scan.coverage()
    (hole,) = view.as_dict()['missing_deg']
    start = math.degrees(scan.plan.sweeps[0].start)
    expected = start + max(lost[0], 0.0), start + min(lost[1], 360.0)
    turns = 360.0 * math.floor(expected[0] / 360.0)
    assert hole == pytest.approx([angle - turns for angle in expected], abs=2.0)
    assert view.why.startswith('view 0 (laser left): no profiles from')


def test_missing_angles_are_taken_again_as_a_view_of_its_own():
    scan = Scan()
    sweep = scan.plan.sweeps[0]
    scan.take(sweep, lost=(90.0, 184.0))
    (retake,) = scan.completeness.retakes(sweep, scan.headers)
    assert retake.views == (1, -1)
    begin = math.degrees(retake.start - sweep.start)
    assert begin < 90.0
    assert begin + math.degrees(retake.span) > 184.0
    assert retake.span / retake.profiles == pytest.approx(sweep.span / sweep.profiles, rel=0.02)
    scan.take(after_position(retake, MOTION, sweep.end(MOTION)))
    assert scan.completeness.retakes(sweep, scan.headers) == []
    (view,) = scan.coverage()
    assert (view.why, view.retaken) == ('', (1,))


def test_short_hole_is_taken_again_with_enough_profiles_for_the_motion_model():
    scan = Scan()
    scan.take(scan.plan.sweeps[0], lost=(90.0, 98.0))
    (retake,) = scan.completeness.retakes(scan.plan.sweeps[0], scan.headers)
    assert retake.profiles >= 20


def test_many_holes_are_taken_again_in_few_sweeps():
    scan = Scan()
    sweep = scan.plan.sweeps[0]
    scan.take(sweep)
    holes = (30.0, 100.0, 170.0, 240.0, 310.0)
    start = math.degrees(sweep.start - scan.turns)
    scan.headers = {
        seq: header
        for seq, header in scan.headers.items()
        if all(not hole <= math.degrees(header.angle) - start < hole + 9.0 for hole in holes)
    }
    retakes = scan.completeness.retakes(sweep, scan.headers)
    assert len(retakes) == 3
    ranges = [
        [math.degrees(angle) - start for angle in (one.start, one.start + one.span)]
        for one in retakes
    ]
    for hole in holes:
        assert any(low < hole and hole + 9.0 < high for low, high in ranges)


def test_view_with_too_few_profiles_is_incomplete():
    scan = Scan()
    sweep = scan.plan.sweeps[0]
    scan.take(sweep)
    scan.headers = {seq: header for seq, header in scan.headers.items() if seq % 2}
    (retake,) = scan.completeness.retakes(sweep, scan.headers)
    assert retake.span == pytest.approx(sweep.span)
    (view,) = scan.coverage()
    assert 'of 200 profiles were received' in view.why


def test_view_without_a_stripe_is_incomplete():
    scan = Scan()
    scan.take(scan.plan.sweeps[0], points=0)
    (view,) = scan.coverage()
    assert 'only 0.0 % of the profiles have a stripe' in view.why


def test_all_profiles_at_one_angle_are_incomplete():
    scan = Scan()
    sweep = scan.plan.sweeps[0]
    scan.completeness.begin(sweep)
    for _ in range(218):
        scan.stamp_ns += PERIOD_NS
        scan.add(0, sweep.begin(MOTION), 50)
    (view,) = scan.coverage()
    begin = round(math.degrees(sweep.start), 1)
    assert view.as_dict()['missing_deg'] == [[begin, begin + 360.0]]


def test_angles_that_the_registrar_dropped_make_the_scan_incomplete():
    scan = Scan(position=20.0)
    sweep = scan.plan.sweeps[0]
    scan.take(sweep)
    begin = sweep.start - scan.turns
    whole = {'view': 0, 'runs': [[begin - 0.1, begin + TURN + 0.1]]}
    assert scan.coverage([whole])[0].why == ''
    half = {'view': 0, 'runs': [[begin - 0.1, begin + 2.0], [begin + 4.0, begin + TURN + 0.1]]}
    (hole,) = scan.coverage([half])[0].missing
    turns = TURN * math.floor((begin + 2.0) / TURN)
    assert hole == pytest.approx((begin + 2.0 - turns, begin + 4.0 - turns), abs=1e-6)
    (low, high) = scan.coverage([{'view': 7, 'runs': []}])[0].missing[0]
    assert high - low == pytest.approx(TURN)


def test_lost_images_of_a_sweep_are_counted():
    scan = Scan()
    scan.take(scan.plan.sweeps[0])
    assert scan.completeness.lost_images(scan.headers, scan.infos) == {
        'not_received': 0, 'not_taken': 0,
    }  # fmt: skip
    for seq in (50, 51, 90):
        del scan.headers[seq]
    assert scan.completeness.lost_images(scan.headers, scan.infos)['not_received'] == 3
    stalled = Scan()
    stalled.take(stalled.plan.sweeps[0], lost=(90.0, 108.0))
    found = stalled.completeness.lost_images(stalled.headers, stalled.infos)
    assert found == {'not_received': 0, 'not_taken': 10}


def test_camera_that_is_triggered_has_no_frame_rate_to_miss_images_by():
    scan = Scan()
    sweep = replace(scan.plan.sweeps[0], trigger_step=0.02)
    scan.take(sweep, lost=(90.0, 108.0))
    found = scan.completeness.lost_images(scan.headers, scan.infos)
    assert found == {'not_received': 0, 'not_taken': 0}


def interrupted(degrees, homed=False, **values):
    """Return a scan whose first sweep ended so many degrees after its start, and what is left."""
    scan = Scan(position=20.0, **values)
    sweep = scan.plan.sweeps[0]
    scan.take(sweep, lost=(degrees, 1000.0))
    first = len(scan.headers)
    begun = [Sweep.from_dict(one.as_dict()) for one in scan.completeness.executed]
    # as after a restart: the triangulator leaves out other turns, and the table may be homed
    scan.completeness = Completeness(scan.plan, MOTION)
    scan.completeness.take_over(begun, [0, first])
    scan.turns = None
    position = 0.0 if homed else 50.0
    left = [
        after_position(one, MOTION, position)
        for one in scan.completeness.remaining(begun[0], scan.headers)
    ]
    return scan, begun[0], left


@pytest.mark.parametrize('homed', [False, True])
@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_interrupted_sweep_is_taken_again_from_where_it_ended(motion, homed):
    scan, sweep, left = interrupted(144.0, homed=homed, motion=motion)
    (rest,) = left
    step = TURN / 200
    assert rest.retake_of == 0
    assert rest.views == (1, -1)
    assert rest.profiles < 0.65 * sweep.profiles
    assert rest.span / rest.profiles == pytest.approx(step, rel=0.01)
    assert rest.begin(MOTION) >= (-1e-3 if homed else 50.0 - 1e-3)
    assert rest.begin(MOTION) < (0.0 if homed else 50.0) + TURN
    scan.take(rest)
    assert scan.completeness.remaining(sweep, scan.headers) == []
    assert scan.completeness.retakes(sweep, scan.headers) == []
    (view,) = scan.coverage()
    assert (view.why, view.retaken) == ('', (1,))
    assert view.profiles >= 200
    # the angles of the registrar are in the frame of each part, too
    runs = [
        {'view': number, 'runs': [(min(angles), max(angles))]}
        for number in (0, 1)
        if (angles := [h.angle for h in scan.headers.values() if h.view == number])
    ]
    assert scan.coverage(runs)[0].why == ''
    ((low, high),) = scan.coverage(runs[:1])[0].missing
    assert math.degrees(high - low) == pytest.approx(216.0, abs=3.7)


def test_stops_at_which_one_laser_has_no_profile_are_taken_again_with_both():
    scan = Scan(motion='step', lasers=('left', 'right'), profiles=40)
    sweep = scan.plan.sweeps[0]
    scan.completeness.begin(sweep)
    for number, angle in enumerate(sweep.angles()[:20]):
        for view in (0, 1)[: 1 if number == 19 else 2]:
            scan.add(view, angle, 50)
    (rest,) = scan.completeness.remaining(sweep, scan.headers)
    assert rest.views == (2, 3)
    # three stops before the one that lacks a profile, so that the views overlap, and three beyond
    assert rest.start == pytest.approx(sweep.angles()[16])
    assert rest.profiles == 27
    (again,) = [scan.completeness._retake(sweep, (sweep.angles()[0], sweep.angles()[-1]))]
    assert (again.views, again.start, again.profiles) == ((4, 5), sweep.start, 40)


@pytest.mark.parametrize('profiles', [0, 5, 19])
def test_view_that_is_too_short_for_the_motion_model_is_taken_again_as_a_whole(profiles):
    scan, sweep, (rest,) = interrupted(1.8 * profiles - 0.1)
    assert (rest.span, rest.profiles) == (pytest.approx(sweep.span), sweep.profiles)
    scan.take(rest)
    assert scan.coverage()[0].why == ''


def test_retake_that_is_interrupted_is_completed():
    scan, sweep, (rest,) = interrupted(180.0)
    scan.take(rest, lost=(90.0, 1000.0))
    begun = scan.completeness.executed
    third = len(scan.headers)
    parts = [0, scan.completeness._parts[1], third]
    scan.completeness = Completeness(scan.plan, MOTION)
    scan.completeness.take_over(begun, parts)
    scan.turns = None
    (last,) = scan.completeness.remaining(begun[0], scan.headers)
    assert last.views == (2, -1)
    assert last.profiles < 0.35 * sweep.profiles
    scan.take(after_position(last, MOTION, 0.0))
    (view,) = scan.coverage()
    assert (view.why, view.retaken) == ('', (1, 2))


def far_from_the_axis(angle):
    """Return the radius of a part that is 50 mm at 90 to 180 degrees, and 10 mm elsewhere."""
    return 0.05 if math.pi / 2 <= angle % TURN <= math.pi else 0.01


@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_angles_of_wide_spacing_are_taken_again_in_finer_steps(motion):
    # 1.8 degrees are 1.57 mm at 50 mm and 0.31 mm at 10 mm
    scan = Scan(motion=motion, max_spacing=0.5e-3, lasers=('left', 'right'))
    scan.radius = far_from_the_axis
    position = 0.0
    for sweep in scan.plan.sweeps:
        scan.take(sweep)
        (denser,) = scan.completeness.retakes(sweep, scan.headers)
        assert denser.span / denser.profiles == pytest.approx(0.4e-3 / 0.05, rel=0.01)
        begin = math.degrees(denser.start) % 360.0
        assert 75.0 < begin < 91.0
        assert 90.0 < math.degrees(denser.span) < 110.0
        position = max(position, sweep.end(MOTION))
        scan.take(after_position(denser, MOTION, position))
        assert scan.completeness.retakes(sweep, scan.headers) == []
    for view in scan.coverage():
        assert view.why == ''
        assert 0.3e-3 < view.spacing <= 0.5e-3
        assert view.as_dict()['largest_spacing_mm'] == pytest.approx(1e3 * view.spacing, abs=1e-3)


def test_spacing_that_cannot_be_met_is_said():
    scan = Scan(max_spacing=0.1e-3)
    scan.radius = lambda angle: 0.05
    (sweep,) = scan.plan.sweeps
    scan.take(sweep)
    (denser,) = scan.completeness.retakes(sweep, scan.headers)
    # never more than ten times the planned number
    assert denser.profiles <= 10 * sweep.profiles
    (view,) = scan.coverage()
    assert view.why == (
        'view 0 (laser left): neighboring profiles are up to 1.57 mm apart on the part, '
        'max_spacing is 0.10 mm'
    )


def test_missing_angles_come_before_finer_steps():
    scan = Scan(max_spacing=0.5e-3)
    scan.radius = far_from_the_axis
    (sweep,) = scan.plan.sweeps
    scan.take(sweep, lost=(200.0, 260.0))
    (retake,) = scan.completeness.retakes(sweep, scan.headers)
    assert retake.span / retake.profiles == pytest.approx(sweep.span / sweep.profiles, rel=0.02)


def test_spacing_without_a_limit_is_only_stated():
    scan = Scan()
    scan.radius = lambda angle: 0.05
    (sweep,) = scan.plan.sweeps
    scan.take(sweep)
    assert scan.completeness.retakes(sweep, scan.headers) == []
    (view,) = scan.coverage()
    assert (view.why, view.spacing) == ('', pytest.approx(0.05 * math.radians(1.8)))


def test_camera_that_pulses_trigger_cannot_take_finer_steps():
    scan = Scan(max_spacing=0.5e-3)
    scan.radius = lambda angle: 0.05
    sweep = replace(scan.plan.sweeps[0], trigger_step=math.radians(1.8))
    scan.take(sweep)
    assert scan.completeness.retakes(sweep, scan.headers) == []
    assert 'max_spacing is 0.50 mm' in scan.coverage()[0].why


@pytest.mark.parametrize('max_spacing', [-1.0, 1e-9, math.nan])
def test_spacing_that_is_none_is_refused(max_spacing):
    with pytest.raises(ParameterError, match='max_spacing'):
        CompletenessLimits(max_spacing=max_spacing)
