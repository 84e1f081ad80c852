# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio
from dataclasses import replace

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import StateError
from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.scan.state_machine import StateMachine

MOTION = MotionLimits()


class FakeTools:
    """Records its calls; ``at`` maps the name of a call to a function that is called then."""

    def __init__(self, machine, at=None):
        self.machine = machine
        self.done = []
        self.lit = None
        self.profile_rate = 10.0
        self.missing = []
        self.inspects = False
        self.verdicts = []
        self.warmed = []
        self._at = at or {}
        self.position = 0.0
        self.left = {}

    def _do(self, *what):
        self.done.append(what)
        self._at.get(what[0], lambda: None)()

    async def prepare(self):
        self._do('prepare')

    async def select_views(self, sweep):
        self._do('select', sweep.views)

    async def move(self, position, velocity):
        self._do('move', round(position, 6), round(velocity, 6))

    async def expose(self, seconds):
        if seconds:
            self._do('expose', seconds)

    async def laser_on(self, laser):
        self.lit = laser
        self._do('light', laser)

    def lasers_off(self):
        self.lit = None

    async def warm_up(self, sweep):
        assert self.lit is None
        self.warmed.append(sweep.lasers)
        self.lit = sweep.lasers[-1]

    async def take_dark_frame(self):
        assert self.lit is None
        self._do('dark_frame')

    async def check_lasers_off(self):
        assert self.lit is None
        self._do('dark_check')

    async def wait_for_profile(self, view):
        self._do('profile', view)

    async def measure_profile_rate(self, sweep):
        self._do('rate')
        return self.profile_rate

    async def trigger_camera(self, *, on):
        self._do('trigger', on)

    async def wait_for_sweep_profiles(self, sweep):
        self._do('settled')

    async def wait_until_resumed(self):
        assert self.lit is None
        self._do('resumed')

    async def wait_until_recorded(self):
        self._do('recorded')

    async def register(self):
        self._do('register')
        return {'views': 2}

    def retakes(self, sweep):
        self._do('retakes', sweep.number)
        return self.missing.pop(0) if self.missing else []

    def remaining(self, sweep):
        self._do('remaining', sweep.number)
        return self.left.get(sweep.number, [])

    def judge(self, outcome):
        for code, detail in self.verdicts:
            outcome.mark(code, detail)

    async def build_mesh(self):
        self._do('build')
        return {'faces': 12}

    async def inspect(self, outcome):
        self._do('inspect', outcome.code)
        return {'verdict': 'fail'}

    async def finish(self, outcome):
        self._do('finish', outcome.code)

    async def abort(self, outcome):
        self._do('halt', outcome.code)

    def names(self):
        return [what[0] for what in self.done]


def run(at=None, verdicts=(), missing=(), inspects=False, trigger_step=0.0, **values):
    machine = StateMachine()
    stages = []
    machine._on_change = stages.append
    tools = FakeTools(machine, at)
    tools.verdicts, tools.missing = list(verdicts), list(missing)
    tools.inspects = inspects
    request = ScanRequest(**values)
    plan = make_plan(request, ('left', 'right'), MOTION, trigger_step=trigger_step)
    outcome = asyncio.run(run_job(machine, plan, MOTION, tools))
    return tools, outcome, stages


def test_step_scan_stops_for_every_profile():
    tools, outcome, stages = run(motion='step', profiles=3)
    assert outcome.code == 'OK'
    assert outcome.mesh == {'faces': 12}
    assert [what[1] for what in tools.done if what[0] == 'light'] == [
        'left', 'right', 'right', 'left', 'left', 'right',
    ]  # fmt: skip
    assert [what[1] for what in tools.done if what[0] == 'profile'] == [0, 1, 1, 0, 0, 1]
    assert tools.names()[-4:] == ['recorded', 'register', 'build', 'finish']
    assert stages[-1] is Stage.DONE
    assert set(outcome.seconds) == {
        'preparing', 'scanning', 'registering', 'meshing', 'finishing',
    }  # fmt: skip


def test_mesh_is_judged_before_the_scan_finishes_and_its_code_is_that_of_the_scan():
    tools, outcome, stages = run(inspects=True)
    assert tools.names()[-3:] == ['build', 'inspect', 'finish']
    assert stages[-4:] == [Stage.MESHING, Stage.INSPECTING, Stage.FINISHING, Stage.DONE]
    # a part that is out of tolerance is no fault of the scan
    assert (outcome.code, outcome.inspection) == ('OK', {'verdict': 'fail'})
    assert 'inspecting' in outcome.seconds


def test_scan_is_cancelled_while_its_mesh_is_judged():
    machine = StateMachine()
    stages = []
    machine._on_change = stages.append
    tools = FakeTools(machine, {'inspect': machine.cancel})
    tools.inspects = True
    plan = make_plan(ScanRequest(), ('left', 'right'), MOTION)
    outcome = asyncio.run(run_job(machine, plan, MOTION, tools))
    assert outcome.code == 'CANCELLED'
    assert stages[-2:] == [Stage.INSPECTING, Stage.CANCELLED]
    assert 'finish' not in tools.names()


@pytest.mark.parametrize('motion', ['step', 'continuous'])
def test_exposure_is_set_before_each_sweep_and_its_lasers(motion):
    tools, outcome, _ = run(motion=motion, profiles=100, lasers=('left',), exposures=(2e-3, 8e-3))
    assert outcome.code == 'OK'
    assert [what[1] for what in tools.done if what[0] == 'expose'] == [2e-3, 8e-3]
    for index, name in enumerate(tools.names()):
        if name == 'expose':
            following = tools.names()[index + 1 :]
            assert following[0] == 'move'
            assert 'light' in following


def test_dark_frame_comes_first_at_every_stop():
    tools, _, _ = run(motion='step', profiles=3, dark_frames=True)
    steps = [name for name in tools.names() if name in ('move', 'dark_frame', 'light')]
    assert steps == ['move', 'dark_frame', 'light', 'light'] * 3


def test_lasers_warm_up_before_each_sweep():
    tools, _, _ = run(profiles=200)
    assert tools.warmed == [('left',), ('right',)]
    tools, _, _ = run(motion='step', profiles=3)
    assert tools.warmed == [('left', 'right')]


def test_continuous_scan_has_no_dark_frames():
    tools, outcome, _ = run(profiles=200, dark_frames=True)
    assert outcome.code == 'OK'
    assert 'dark_frame' not in tools.names()


def test_sweep_is_selected_where_it_begins_with_the_lasers_off():
    tools, _, _ = run(motion='step', profiles=3, views=2)
    first, second = [i for i, name in enumerate(tools.names()) if name == 'select']
    assert tools.names()[first - 1] == tools.names()[second - 1] == 'move'
    assert tools.names()[second + 1] == 'light'


def test_continuous_scan_has_lead_in_and_lead_out():
    tools, _, _ = run(profiles=200)
    moves = [what[1:] for what in tools.done if what[0] == 'move']
    assert len(moves) == 4
    begin, end = moves[0][0], moves[1][0]
    assert end - begin > 6.2832
    assert moves[1][1] == pytest.approx(0.314159)
    assert moves[2][0] >= end - 2e-3
    assert tools.names()[:6] == ['prepare', 'move', 'select', 'light', 'rate', 'move']


def test_camera_is_triggered_while_the_table_sweeps_only():
    tools, outcome, _ = run(profiles=200, trigger_step=0.02)
    assert outcome.code == 'OK'
    sweep = ['move', 'select', 'light', 'rate', 'trigger', 'move', 'trigger', 'settled']
    names = tools.names()
    assert names[1:9] == sweep
    assert [what[1] for what in tools.done if what[0] == 'trigger'] == [True, False] * 2
    assert 'trigger' not in run(profiles=200)[0].names()
    assert 'trigger' not in run(motion='step', profiles=4, trigger_step=0.02)[0].names()


@pytest.mark.parametrize(('motion', 'profiles'), [('continuous', 200), ('step', 12)])
def test_lasers_are_checked_to_be_off_after_every_sweep(motion, profiles):
    tools, _, _ = run(motion=motion, profiles=profiles, views=2)
    names = tools.names()
    selected = [index for index, name in enumerate(names) if name == 'select']
    checked = [index for index, name in enumerate(names) if name == 'dark_check']
    assert len(checked) == len(selected) > 1
    assert all(first < second for first, second in zip(selected, checked, strict=True))
    assert names.index('retakes') > checked[0]


@pytest.mark.parametrize('where', ['prepare', 'move', 'light', 'settled', 'register', 'build'])
def test_lasers_are_off_after_every_failure(where):
    def fail():
        raise HelperError('CAMERA_LOST', 'no heartbeat')

    tools, outcome, stages = run({where: fail})
    assert outcome.code == 'CAMERA_LOST'
    assert tools.lit is None
    assert tools.done[-1] == ('halt', 'CAMERA_LOST')
    assert stages[-1] is Stage.FAILED


def test_unexpected_exception_ends_the_scan_as_internal_error():
    def fail():
        raise ZeroDivisionError('oh')

    tools, outcome, stages = run({'register': fail})
    assert outcome.code == 'INTERNAL'
    assert 'ZeroDivisionError: oh' in outcome.detail
    assert (tools.lit, stages[-1]) == (None, Stage.FAILED)


def test_incomplete_scan_keeps_its_mesh_and_fails():
    verdicts = [('INCOMPLETE', 'view 0: no profiles'), ('SLIPPED', 'by 3 degrees')]
    tools, outcome, stages = run(verdicts=verdicts, profiles=200)
    assert (outcome.code, outcome.detail) == (
        'INCOMPLETE', 'view 0: no profiles; by 3 degrees',
    )  # fmt: skip
    assert outcome.mesh == {'faces': 12}
    assert tools.done[-1] == ('finish', 'INCOMPLETE')
    assert (tools.lit, stages[-1]) == (None, Stage.FAILED)


def test_missing_angles_are_taken_again_before_the_next_sweep_without_turning_back():
    (first, _) = make_plan(ScanRequest(profiles=200), ('left', 'right'), MOTION).sweeps
    again = replace(first, views=(2, -1), start=1.0, span=1.0, profiles=32, retake_of=0)
    tools, outcome, _ = run(profiles=200, missing=[[again], []])
    assert outcome.code == 'OK'
    selected = [what[1] for what in tools.done if what[0] == 'select']
    assert selected == [(0, -1), (2, -1), (-1, 1)]
    moves = [what[1] for what in tools.done if what[0] == 'move']
    assert len(moves) == 6
    assert moves == sorted(moves)


def test_missing_angles_are_taken_again_twice_at_most():
    (first, _) = make_plan(ScanRequest(profiles=200), ('left', 'right'), MOTION).sweeps
    again = replace(first, views=(2, -1), start=1.0, span=1.0, profiles=32, retake_of=0)
    tools, _, _ = run(profiles=200, missing=[[again]] * 10)
    assert len([what for what in tools.done if what[0] == 'select']) == 2 + 2 * 2


def _run_with(at_each_profile, **values):
    machine = StateMachine()
    tools = FakeTools(machine, {'profile': lambda: at_each_profile(machine)})
    tools._at['resumed'] = machine.resume
    plan = make_plan(ScanRequest(**values), ('left', 'right'), MOTION)
    stages = []
    machine._on_change = stages.append
    return tools, asyncio.run(run_job(machine, plan, MOTION, tools)), stages


def test_cancel_ends_the_scan():
    tools, outcome, stages = _run_with(StateMachine.cancel, motion='step', profiles=5)
    assert outcome.code == 'CANCELLED'
    assert tools.names().count('profile') == 2
    assert (tools.lit, stages[-1]) == (None, Stage.CANCELLED)


def test_paused_scan_resumes_at_the_same_stop():
    once = []

    def pause(machine):
        if not once:
            once.append(True)
            machine.pause()

    tools, outcome, stages = _run_with(pause, motion='step', profiles=4)
    assert outcome.code == 'OK'
    assert tools.names().count('profile') == 8
    assert stages.count(Stage.PAUSED) == 1


@pytest.mark.parametrize('step', ['settled', 'recorded'])
def test_pause_during_the_last_sweep_holds_the_scan_before_it_is_registered(step):
    machine = StateMachine()
    tools = FakeTools(machine, {step: machine.pause, 'resumed': machine.resume})
    plan = make_plan(ScanRequest(lasers=('left',)), ('left', 'right'), MOTION)
    outcome = asyncio.run(run_job(machine, plan, MOTION, tools))
    assert outcome.code == 'OK'
    names = tools.names()
    assert names.index('resumed') < names.index('register')


def test_requests_are_refused_while_a_failed_scan_ends():
    def fail():
        raise HelperError('CAMERA_LOST', 'no heartbeat')

    refused = []

    def cancel(machine):
        with pytest.raises(StateError, match='is ending'):
            machine.cancel()
        refused.append(True)

    machine = StateMachine()
    tools = FakeTools(machine, {'recorded': fail, 'halt': lambda: cancel(machine)})
    plan = make_plan(ScanRequest(), ('left', 'right'), MOTION)
    assert asyncio.run(run_job(machine, plan, MOTION, tools)).code == 'CAMERA_LOST'
    assert refused


def test_resumed_scan_takes_what_is_missing_of_the_begun_sweeps_and_then_the_others():
    plan = make_plan(ScanRequest(views=2, overlap=0.1), ('left', 'right'), MOTION)
    first, second = plan.sweeps[:2]
    machine = StateMachine()
    tools = FakeTools(machine)
    tools.left = {1: [replace(second, start=second.start + 1.0, span=0.5, views=(-1, 4))]}
    tools.position = 30.0
    outcome = asyncio.run(run_job(machine, plan, MOTION, tools, (first, second)))
    assert outcome.code == 'OK'
    assert [what[1] for what in tools.done if what[0] == 'remaining'] == [0, 1]
    taken = [what[1] for what in tools.done if what[0] == 'select']
    assert taken == [(-1, 4), plan.sweeps[2].views, plan.sweeps[3].views]
    # in positive direction from where the table stands
    moves = [what[1] for what in tools.done if what[0] == 'move']
    assert moves == sorted(moves)
    assert moves[0] == pytest.approx(30.0, abs=6.3)


def test_table_that_was_homed_is_not_wound_up_again():
    plan = make_plan(ScanRequest(lasers=('left',)), ('left', 'right'), MOTION, position=40.0)
    tools = FakeTools(StateMachine())
    tools.left = {0: [plan.sweeps[0]]}
    asyncio.run(run_job(tools.machine, plan, MOTION, tools, plan.sweeps))
    moves = [what[1] for what in tools.done if what[0] == 'move']
    assert -0.1 < moves[0] < 6.3


def test_nothing_is_taken_again_of_a_scan_that_was_interrupted_behind_its_last_sweep():
    plan = make_plan(ScanRequest(), ('left', 'right'), MOTION)
    tools = FakeTools(StateMachine())
    outcome = asyncio.run(run_job(tools.machine, plan, MOTION, tools, plan.sweeps))
    assert (outcome.code, outcome.mesh) == ('OK', {'faces': 12})
    assert not {'move', 'select', 'light'} & set(tools.names())
