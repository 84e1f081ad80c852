# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import pytest

from ivfmc_ros.devices.beam import BeamKeeper
from ivfmc_ros.devices.beam import BeamRules
from ivfmc_ros.devices.grbl.controller import GrblBoard
from ivfmc_ros.devices.grbl.settings import GrblSettings
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
        GrblBoard(GrblSettings(port=str(tmp_path / 'board'), lasers=lasers)),
        BeamKeeper(list(lasers), BeamRules(hold_timeout=0.5)),
        velocity=6.0,
    )
    driver.start()
    until(lambda: not driver.trouble)
    yield driver
    driver.close()


def shine(driver, name):
    def lit():
        driver.hold(name)
        return driver.state().lasers[name]

    until(lit)


def test_move_that_follows_the_end_of_a_beam_at_once_is_made(driver):
    # the guard stops a table that turns while a beam shines that shall not
    for number in range(1, 13):
        shine(driver, 'left')
        driver.hold('')
        driver.command(0.05 * number, 0.0)
        until(lambda n=number: abs(driver.state().position - 0.05 * n) < 1e-3, 3.0)
        assert not any(driver.state().lasers.values())
        assert not driver.refused


def test_beam_that_is_held_shines_through_a_move(driver):
    shine(driver, 'left')
    driver.command(0.2, 0.0)

    def there():
        driver.hold('left')
        return abs(driver.state().position - 0.2) < 1e-3

    until(there)
    assert driver.state().lasers['left']


def test_numbers_that_are_none_are_no_command(driver):
    with pytest.raises(ParameterError, match='must be finite'):
        driver.command(float('nan'), 0.0)


def once(function):
    """A function that raises what nobody thinks of, and then does what it did."""
    raised = []

    def raising(*arguments):
        if not raised:
            raised.append(True)
            raise KeyError('unthought of')
        return function(*arguments)

    return raising


@pytest.mark.parametrize(('part', 'name'), [('_board', 'move_to'), ('_beam', 'decide')])
def test_threads_go_on_after_what_nobody_thought_of(driver, monkeypatch, part, name):
    owner = getattr(driver, part)
    monkeypatch.setattr(owner, name, once(getattr(owner, name)))
    driver.command(0.1, 0.0)
    until(lambda: 'KeyError' in driver.trouble)
    driver.command(0.2, 0.0)
    until(lambda: abs(driver.state().position - 0.2) < 1e-3)
    shine(driver, 'left')
    # the guard lives: nobody vouches for the beam any more
    driver.command(20.0, 30.0)
    until(lambda: not any(driver.state().lasers.values()))


def test_board_whose_reader_fails_is_lost(driver, monkeypatch):
    monkeypatch.setattr(driver._board._monitor, 'hear', once(driver._board._monitor.hear))
    until(lambda: driver.state().alarm == 'BOARD_LOST')
    driver.clear_alarm()
    driver.command(0.1, 0.0)
    until(lambda: abs(driver.state().position - 0.1) < 1e-3)
