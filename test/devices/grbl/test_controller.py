# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
import threading
import time

import pytest

from ivfmc_ros.devices.grbl.controller import GrblBoard
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.errors import BoardAlarmError
from ivfmc_ros.errors import BoardLostError
from ivfmc_ros.errors import BoardRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError
from ivfmc_ros.simulation.grbl.emulator import BoardEmulator

FAST = (2.0, 2 * math.pi)  # rad/s, rad/s^2


def until(condition, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f'not within {seconds} s')
        time.sleep(0.005)


def arrive(board):
    until(lambda: not board.poll().moving)
    return board.poll()


def true_degrees(emulator):
    return emulator.machine.axis.at(time.monotonic())[0]


def test_moves_end_at_their_targets(board, emulator):
    for target in (0.1, -0.2, 3.0):
        board.move_to(target, *FAST)
        assert board.poll().moving
        state = arrive(board)
        assert state.position == pytest.approx(target, abs=1e-4)
        assert state.velocity == 0.0
        # one step is 0.00625 degrees
        assert math.radians(true_degrees(emulator)) == pytest.approx(target, abs=1e-4)


def test_ok_to_a_move_is_not_arrival(board):
    start = time.monotonic()
    board.move_to(0.5, 0.5, 2 * math.pi)
    assert time.monotonic() - start < 0.3
    arrive(board)
    assert time.monotonic() - start > 1.0


def test_position_between_reports_follows_the_table(board, emulator):
    board.move_to(1.0, 0.5, 2 * math.pi)
    errors = []
    while board.poll().moving:
        errors.append(math.degrees(board.poll().position) - true_degrees(emulator))
        time.sleep(0.01)
    assert len(errors) > 100
    # 30 degrees a second, a machine that tests share: 20 ms
    assert sorted(map(abs, errors))[len(errors) * 9 // 10] < 0.6


def test_reported_position_is_told_apart(board):
    board.move_to(1.0, 1.0, 2 * math.pi)
    states = []
    while board.poll().moving:
        states.append(board.poll())
        time.sleep(0.002)
    assert len({state.position for state in states}) > 10 * len({s.reported for s in states})


def test_questions_are_asked_at_most_ten_times_a_second(board, emulator):
    asked = []
    answer = emulator.machine._question
    emulator.machine._question = lambda now: asked.append(now) or answer(now)
    board.move_to(1.5, 1.0, 2 * math.pi)
    arrive(board)
    assert 8 <= len(asked) <= 20


def test_units_per_turn_scale_and_turn_the_axis(emulator, tmp_path):
    board = GrblBoard(GrblSettings(port=str(tmp_path / 'board'), units_per_turn=-90.0))
    board.open()
    board.move_to(math.pi / 2, *FAST)
    assert arrive(board).position == pytest.approx(math.pi / 2, abs=1e-4)
    assert true_degrees(emulator) == pytest.approx(-22.5)
    board.close()


def test_one_laser_at_a_time(board, emulator):
    for name, lit in (('left', (1.0, 0.0)), ('right', (0.0, 1.0)), (None, (0.0, 0.0))):
        stamp_ns = board.set_laser(name)
        outputs = emulator.machine._lit()
        assert (outputs.spindle, outputs.coolant) == lit
        assert abs(time.time_ns() - stamp_ns) < 1e9
        assert [key for key, on in board.poll().lasers.items() if on] == ([name] if name else [])


def test_power_of_the_spindle_laser(emulator, tmp_path):
    settings = GrblSettings(port=str(tmp_path / 'board'), lasers={'a': 'spindle'}, power=0.25)
    board = GrblBoard(settings)
    board.open()
    board.set_laser('a')
    assert emulator.machine._lit().spindle == pytest.approx(0.25)
    board.close()


def test_laser_in_laser_mode_shines_at_standstill(board, emulator):
    emulator.machine.settings[32] = 1.0
    board.set_laser('left')
    assert emulator.machine._lit().spindle == 1.0


def test_laser_waits_for_the_end_of_the_motion(board):
    board.move_to(0.5, 0.5, 2 * math.pi)
    start = time.monotonic()
    board.set_laser('left')
    assert time.monotonic() - start > 0.7
    assert not board.poll().moving


def test_stop_brakes_darkens_and_keeps_the_position(board, emulator):
    board.set_laser('left')
    board.move_to(3.0, 1.0, 2 * math.pi)
    time.sleep(0.5)
    board.stop()
    state = board.poll()
    assert state.alarm is None
    assert not state.moving
    assert not any(state.lasers.values())
    assert emulator.machine._lit().spindle == 0.0
    assert 0.2 < state.position < 1.5
    assert state.position == pytest.approx(math.radians(true_degrees(emulator)), abs=1e-4)


def test_stop_gives_up_a_laser_that_waits(board):
    board.move_to(3.0, 0.5, 2 * math.pi)
    errors = []

    def switch():
        try:
            board.set_laser('right')
        except DeviceError as error:
            errors.append(error)

    thread = threading.Thread(target=switch)
    thread.start()
    time.sleep(0.3)
    board.stop()
    thread.join(timeout=2.0)
    assert [type(error) for error in errors] == [StoppedError]
    assert not any(board.poll().lasers.values())


def test_new_move_replaces_the_old_one(board):
    board.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.3)
    board.move_to(0.05, *FAST)
    assert arrive(board).position == pytest.approx(0.05, abs=1e-4)


def test_restart_in_mid_job_is_a_lost_position(board, emulator):
    board.set_laser('left')
    board.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.3)
    emulator.fault('reset')
    until(lambda: board.poll().alarm == 'POSITION_LOST')
    assert not any(board.poll().lasers.values())
    with pytest.raises(BoardAlarmError, match='POSITION_LOST'):
        board.move_to(0.0, *FAST)
    board.clear_alarm()
    board.move_to(0.1, *FAST)
    assert arrive(board).position == pytest.approx(0.1, abs=1e-4)


@pytest.mark.parametrize('number', [1, 3])
def test_alarm_locks_until_it_is_cleared(board, emulator, number):
    emulator.fault(f'alarm {number}')
    until(lambda: board.poll().alarm == f'ALARM_{number}')
    with pytest.raises(BoardAlarmError):
        board.set_laser('left')
    board.clear_alarm()
    board.set_laser('left')


def test_alarm_ends_a_command_that_waits(board, emulator):
    board.move_to(3.0, 0.5, 2 * math.pi)
    threading.Timer(0.3, emulator.fault, ['alarm 1']).start()
    with pytest.raises(BoardAlarmError, match='limit switch'):
        board.set_laser('left')


def test_silence_is_a_lost_board_and_no_hang(board, emulator):
    emulator.fault('silence 60')
    start = time.monotonic()
    with pytest.raises(BoardLostError):
        board.set_laser('left')
    assert time.monotonic() - start < 5.0
    until(lambda: board.poll().alarm == 'BOARD_LOST')
    with pytest.raises(BoardLostError):
        board.move_to(1.0, *FAST)


def test_board_that_speaks_again_is_connected_by_clear_alarm(board, emulator):
    emulator.fault('silence 2')
    until(lambda: board.poll().alarm == 'BOARD_LOST')
    time.sleep(0.5)
    board.clear_alarm()
    assert board.poll().alarm is None


def test_unplugged_port_is_a_lost_board(board, emulator):
    emulator.fault('unplug')
    until(lambda: board.poll().alarm == 'BOARD_LOST')
    with pytest.raises(BoardLostError):
        board.stop()
    with pytest.raises(BoardLostError, match='cannot be opened'):
        board.clear_alarm()


def test_noise_is_no_answer(board, emulator):
    for _ in range(20):
        emulator.fault('noise')
        board.set_laser('left')
        board.set_laser(None)
    assert board.poll().alarm is None


def test_lost_answer_to_a_move_is_no_hang(board, emulator):
    say = emulator.machine._say
    lost = []

    def lose_first_ok(text):
        if text == 'ok\r\n' and not lost:
            lost.append(text)
        else:
            say(text)

    emulator.machine._say = lose_first_ok
    start = time.monotonic()
    board.move_to(0.2, *FAST)
    assert lost
    assert time.monotonic() - start < 4.0
    assert arrive(board).position == pytest.approx(0.2, abs=1e-4)


def test_lost_bytes_are_survived_or_said(board, emulator):
    emulator.fault('drop 0.003')
    deadline = time.monotonic() + 20.0
    for step in range(20):
        try:
            board.move_to(0.02 * step, *FAST)
            board.set_laser('left' if step % 2 else None)
        except DeviceError:
            emulator.fault('drop 0')
            board.clear_alarm()
            emulator.fault('drop 0.003')
    emulator.fault('drop 0')
    if board.poll().alarm is not None:
        board.clear_alarm()
    arrive(board)
    assert time.monotonic() < deadline
    assert board.poll().position == pytest.approx(math.radians(true_degrees(emulator)), abs=1e-3)


def test_output_that_nobody_turned_on_is_an_alarm(board, emulator):
    emulator.machine._modes.coolant = 'M8'
    emulator.machine._report.refresh()
    until(lambda: board.poll().alarm == 'LASER_UNEXPECTED')
    assert board.poll().lasers == {'left': False, 'right': True}


def test_home_finds_the_position_again(tmp_path):
    emulator = BoardEmulator(tmp_path / 'board', homing=True)
    emulator.machine.settings[25] = 36000.0
    emulator.machine.settings[110] = 36000.0
    emulator.machine.settings[120] = 3600.0
    emulator.start()
    board = GrblBoard(GrblSettings(port=str(tmp_path / 'board'), lasers={'a': 'coolant'}))
    board.open()
    assert board.poll().alarm == 'LOCKED'
    with pytest.raises(BoardAlarmError):
        board.move_to(1.0, *FAST)
    board.home()
    assert board.poll().alarm is None
    # it stands a degree before the switch; which turn that is nobody knows
    home = math.degrees(board.poll().position)
    assert (home + 1.0) % 360 == pytest.approx(0.0, abs=0.01) or home == pytest.approx(-1.0)
    board.set_laser('a')
    board.close()
    emulator.stop()


def test_home_without_a_switch_is_refused(board):
    with pytest.raises(BoardRefusedError, match=r'\$22'):
        board.home()


def test_acceleration_is_written_only_when_it_differs(board, emulator):
    emulator.machine.settings[120] = 360.0
    written = []
    write = emulator.machine._set
    emulator.machine._set = lambda *pair: written.append(pair) or write(*pair)
    board.move_to(0.01, 1.0, 2 * math.pi)
    arrive(board)
    board.move_to(0.02, 1.0, math.pi)
    arrive(board)
    board.move_to(0.03, 1.0, math.pi)
    assert written == [(120, 180.0)]


def test_close_darkens_and_stops(emulator, tmp_path):
    board = GrblBoard(GrblSettings(port=str(tmp_path / 'board'), lasers={'a': 'coolant'}))
    board.open()
    board.set_laser('a')
    board.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.2)
    board.close()
    assert emulator.machine._lit().coolant == 0.0
    assert not emulator.machine.axis.moving


def test_missing_port_is_refused(tmp_path):
    board = GrblBoard(GrblSettings(port=str(tmp_path / 'none')))
    with pytest.raises(BoardLostError, match='none'):
        board.open()
    board.close()


def test_port_that_somebody_uses_is_refused(board, tmp_path):
    other = GrblBoard(GrblSettings(port=str(tmp_path / 'board')))
    with pytest.raises(BoardLostError, match='cannot be opened'):
        other.open()


def test_unknown_laser_is_refused(board):
    with pytest.raises(ParameterError, match='left, right'):
        board.set_laser('middle')


@pytest.mark.parametrize(
    'motion', [(math.nan, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, -1.0), (1.0, math.inf, 1.0)]
)
def test_motion_that_is_none_is_refused(board, motion):
    with pytest.raises(ParameterError):
        board.move_to(*motion)


@pytest.mark.parametrize(
    'wrong',
    [
        {'axis': 'Q'},
        {'units_per_turn': 0.0},
        {'units_per_turn': math.nan},
        {'power': 1.5},
        {'lasers': {'a': 'mist'}},
        {'lasers': {'a': 'spindle', 'b': 'spindle'}},
    ],
)
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ParameterError):
        GrblSettings(port='x', **wrong)
