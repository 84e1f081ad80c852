# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import pytest

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.devices.turntable import TurntableDriver
from ivfmc_ros.errors import ParameterError


def until(condition, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f'not within {seconds} s')
        time.sleep(0.002)


@pytest.fixture
def driver(emulator, tmp_path):
    lasers = {'left': 'spindle', 'right': 'coolant'}
    driver = TurntableDriver(
        GrblController(ControllerSettings(port=str(tmp_path / 'controller'), lasers=lasers)),
        BeamInterlock(list(lasers), BeamSettings(hold_timeout=0.5)),
        velocity=6.0,
    )
    driver.start()
    until(lambda: not driver.fault)
    yield driver
    driver.close()


def turn_on(driver, name):
    def is_on():
        driver.hold(name)
        return driver.state().lasers[name]

    until(is_on)


def test_move_right_after_the_laser_goes_off_is_executed(driver):
    # the watchdog stops a table that moves while a laser is on that must be off
    for number in range(1, 13):
        turn_on(driver, 'left')
        driver.hold('')
        driver.command(0.05 * number, 0.0)
        until(lambda n=number: abs(driver.state().position - 0.05 * n) < 1e-3, 3.0)
        assert not any(driver.state().lasers.values())
        assert not driver.rejection


def test_held_laser_stays_on_during_a_move(driver):
    turn_on(driver, 'left')
    driver.command(0.2, 0.0)

    def arrived():
        driver.hold('left')
        return abs(driver.state().position - 0.2) < 1e-3

    until(arrived)
    assert driver.state().lasers['left']


def test_laser_whose_hold_was_interrupted_does_not_shine_on_a_standing_table(driver):
    turn_on(driver, 'left')
    driver.command(20.0, 40.0)
    until(lambda: driver.hold('left') or driver.state().moving)
    # the node hangs, and its watchdog turns the laser off
    until(lambda: not any(driver.state().lasers.values()))
    until(lambda: not driver.state().moving)
    end = time.monotonic() + 0.7
    while time.monotonic() < end:
        driver.hold('left')
        assert not any(driver.state().lasers.values())
        time.sleep(0.02)
    assert 'stopped in a move' in driver.rejection
    driver.hold('')
    turn_on(driver, 'left')


def test_command_that_is_not_finite_is_refused(driver):
    with pytest.raises(ParameterError, match='must be finite'):
        driver.command(float('nan'), 0.0)


def once(function):
    """Return a function that raises an unexpected error once, and works from then on."""
    raised = []

    def raising(*arguments):
        if not raised:
            raised.append(True)
            raise KeyError('unexpected')
        return function(*arguments)

    return raising


@pytest.mark.parametrize(('part', 'name'), [('_controller', 'move_to'), ('_interlock', 'decide')])
def test_threads_continue_after_an_unexpected_error(driver, monkeypatch, part, name):
    owner = getattr(driver, part)
    monkeypatch.setattr(owner, name, once(getattr(owner, name)))
    driver.command(0.1, 0.0)
    until(lambda: 'KeyError' in driver.fault)
    driver.command(0.2, 0.0)
    until(lambda: abs(driver.state().position - 0.2) < 1e-3)
    turn_on(driver, 'left')
    # the watchdog runs: beam_hold has ended
    driver.command(20.0, 30.0)
    until(lambda: not any(driver.state().lasers.values()))


def test_controller_is_lost_when_its_reader_fails(driver, monkeypatch):
    monkeypatch.setattr(
        driver._controller._monitor, 'handle_line', once(driver._controller._monitor.handle_line)
    )
    until(lambda: driver.state().alarm == 'CONTROLLER_LOST')
    driver.clear_alarm()
    driver.command(0.1, 0.0)
    until(lambda: abs(driver.state().position - 0.1) < 1e-3)


@pytest.fixture
def reconnecting(emulator, tmp_path):
    lasers = {'left': 'spindle', 'right': 'coolant'}
    driver = TurntableDriver(
        AnyController(ControllerSettings(port=str(tmp_path / 'controller'), lasers=lasers)),
        BeamInterlock(list(lasers), BeamSettings(hold_timeout=0.5)),
        velocity=6.0,
        reconnect=True,
    )
    driver.start()
    until(lambda: not driver.fault)
    yield driver
    driver.close()


@pytest.mark.parametrize('moving', [False, True])
def test_controller_that_comes_back_is_connected_but_neither_moves_nor_lights(
    reconnecting, emulator, moving
):
    driver = reconnecting
    driver.clear_alarm()
    assert driver.state().homed
    turn_on(driver, 'left')
    if moving:
        driver.command(3.0, 10.0)
        until(lambda: driver.hold('left') or driver.state().moving)
    emulator.fault('unplug')
    until(lambda: driver.hold('left') or driver.state().alarm == 'CONTROLLER_LOST', 2.0)
    emulator.fault('plug')
    until(lambda: driver.hold('left') or driver.state().alarm is None, 4.0)
    state, end = driver.state(), time.monotonic() + 0.5
    while time.monotonic() < end:
        driver.hold('left')
        assert not any(driver.state().lasers.values())
        assert not emulator.machine.axis.moving
    assert (state.homed, driver.state().position) == (False, state.position)
    # a laser that is requested anew lights, and a move works
    driver.hold('')
    turn_on(driver, 'left')
    driver.command(state.position + 0.1, 0.0)
    until(
        lambda: driver.hold('left') or abs(driver.state().position - state.position - 0.1) < 1e-3
    )


def test_controller_that_is_lost_stays_lost_where_reconnect_is_off(reconnecting, emulator):
    driver = reconnecting
    driver.adjust(BeamSettings(), 6.0, 1.0, reconnect=False)
    emulator.fault('unplug')
    until(lambda: driver.state().alarm == 'CONTROLLER_LOST', 2.0)
    emulator.fault('plug')
    time.sleep(1.0)
    assert driver.state().alarm == 'CONTROLLER_LOST'
    driver.clear_alarm()
    assert driver.state().alarm is None


def test_request_for_a_laser_in_a_move_delays_neither_another_move_nor_a_stop(driver, emulator):
    turn_on(driver, 'left')
    driver.command(6.0, 20.0)
    until(lambda: driver.hold('left') or driver.state().moving)
    # the other laser is wanted now, which the controller switches at the end of the motion
    for _ in range(10):
        driver.hold('right')
        time.sleep(0.02)
    here = driver.state().position
    driver.command(here, 0.0)
    start = time.monotonic()
    until(lambda: driver.hold('right') or not driver.state().moving)
    assert time.monotonic() - start < 1.5
    assert driver.state().position < 2.0


def test_interlock_is_evaluated_less_often_only_while_the_cell_is_dark_and_stands(driver):
    decide, decisions = driver._interlock.decide, []
    driver._interlock.decide = lambda: decisions.append(0) or decide()

    def rate():
        decisions.clear()
        begin = time.monotonic()
        until(lambda: len(decisions) >= 10)
        return 10 / (time.monotonic() - begin)

    assert rate() < 15.0
    driver.command(0.5, 4.0)
    until(lambda: driver.state().moving)
    # on a busy computer not each second has its share
    until(lambda: rate() > 25.0)
    assert driver.state().moving
    until(lambda: not driver.state().moving)
    turn_on(driver, 'left')
    until(lambda: driver.hold('left') or rate() > 25.0)


def test_laser_is_switched_at_once_after_a_rest(driver):
    time.sleep(0.3)
    begin = time.monotonic()
    turn_on(driver, 'left')
    assert time.monotonic() - begin < 0.3
    driver.hold('')
    until(lambda: not any(driver.state().lasers.values()), 0.3)


def test_driver_closes_at_once(driver):
    begin = time.monotonic()
    driver.close()
    assert time.monotonic() - begin < 0.45
