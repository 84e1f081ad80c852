# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import StateError
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.scan.state_machine import StateMachine

COURSE = ('PREPARING', 'SCANNING', 'REGISTERING', 'MESHING', 'FINISHING', 'DONE')


def machine_at(stage):
    machine = StateMachine()
    for name in COURSE[: COURSE.index(stage) + 1] if stage != 'IDLE' else ():
        machine.advance(Stage(name))
    return machine


def test_every_transition_calls_on_change():
    changes = []
    machine = StateMachine(changes.append)
    for name in COURSE:
        machine.advance(Stage(name))
    assert changes == [Stage(name) for name in COURSE]
    assert not machine.running


@pytest.mark.parametrize('stage', COURSE[:-1])
@pytest.mark.parametrize('end', [Stage.FAILED, Stage.CANCELLED])
def test_every_running_stage_can_fail_or_be_cancelled(stage, end):
    machine = machine_at(stage)
    machine.advance(end)
    assert not machine.running


@pytest.mark.parametrize(
    ('stage', 'after'),
    [('IDLE', 'SCANNING'), ('DONE', 'PREPARING'), ('IDLE', 'FAILED'), ('SCANNING', 'DONE')],
)
def test_stage_out_of_order_is_refused(stage, after):
    with pytest.raises(StateError, match=f'{after} cannot follow {stage}'):
        machine_at(stage).advance(Stage(after))


@pytest.mark.parametrize('stage', ['REGISTERING', 'FINISHING', 'DONE'])
def test_pause_without_profiles_is_refused(stage):
    with pytest.raises(StateError, match='can be paused while'):
        machine_at(stage).pause()


def test_resume_without_pause_is_refused():
    with pytest.raises(StateError, match='no scan is paused'):
        machine_at('SCANNING').resume()


def test_cancel_without_scan_is_refused():
    with pytest.raises(StateError, match='no scan is running'):
        machine_at('DONE').cancel()


@pytest.mark.parametrize('request_name', ['cancel', 'pause'])
def test_request_to_a_scan_before_its_first_step_is_kept(request_name):
    machine = machine_at('IDLE')
    getattr(machine, request_name)()
    machine.advance(Stage.PREPARING)
    assert machine.pause_requested == (request_name == 'pause')
    if request_name == 'cancel':
        with pytest.raises(CancelledError):
            machine.raise_if_cancelled()


def test_cancel_while_finishing_is_refused():
    with pytest.raises(StateError, match='the mesh is complete'):
        machine_at('FINISHING').cancel()


@pytest.mark.parametrize('request_name', ['cancel', 'pause', 'resume'])
def test_request_to_a_scan_that_is_ending_is_refused(request_name):
    machine = machine_at('SCANNING')
    machine.pause()
    machine.refuse_requests()
    with pytest.raises(StateError, match='is ending'):
        getattr(machine, request_name)()


def test_cancel_makes_the_check_raise():
    machine = machine_at('SCANNING')
    machine.raise_if_cancelled()
    machine.cancel()
    with pytest.raises(CancelledError):
        machine.raise_if_cancelled()
