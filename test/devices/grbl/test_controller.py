# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
import re
import termios
import threading
import time

import numpy as np
import pytest
import serial

from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.errors import ControllerAlarmError
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator
from ivfmc_ros.simulation.grbl.report import ReportFormatter

FAST = (2.0, 2 * math.pi)  # rad/s, rad/s^2


def until(condition, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f'not within {seconds} s')
        time.sleep(0.005)


def arrive(controller):
    until(lambda: not controller.poll().moving)
    return controller.poll()


def true_degrees(emulator):
    return emulator.machine.axis.state_at(time.monotonic())[0]


def test_moves_end_at_their_targets(controller, emulator):
    for target in (0.1, -0.2, 3.0):
        controller.move_to(target, *FAST)
        assert controller.poll().moving
        state = arrive(controller)
        assert state.position == pytest.approx(target, abs=1e-4)
        assert state.velocity == 0.0
        # one step is 0.00625 degrees
        assert math.radians(true_degrees(emulator)) == pytest.approx(target, abs=1e-4)


def test_ok_to_a_move_is_not_arrival(controller):
    start = time.monotonic()
    controller.move_to(0.5, 0.5, 2 * math.pi)
    assert time.monotonic() - start < 0.3
    arrive(controller)
    assert time.monotonic() - start > 1.0


def test_position_between_reports_follows_the_table(controller, emulator):
    controller.move_to(1.0, 0.5, 2 * math.pi)
    errors = []
    while controller.poll().moving:
        errors.append(math.degrees(controller.poll().position) - true_degrees(emulator))
        time.sleep(0.01)
    assert len(errors) > 100
    # 30 degrees a second, on a computer that other tests load: 20 ms
    assert sorted(map(abs, errors))[len(errors) * 9 // 10] < 0.6


def test_reported_position_differs_from_the_estimated_one(controller):
    controller.move_to(1.0, 1.0, 2 * math.pi)
    states = []
    while controller.poll().moving:
        states.append(controller.poll())
        time.sleep(0.002)
    assert len({state.position for state in states}) > 10 * len({s.reported for s in states})


def test_status_is_queried_at_most_ten_times_a_second(controller, emulator):
    queries = []
    answer = emulator.machine._report_status
    emulator.machine._report_status = lambda now: queries.append(now) or answer(now)
    controller.move_to(1.5, 1.0, 2 * math.pi)
    arrive(controller)
    assert 8 <= len(queries) <= 20


def test_units_per_turn_scale_and_turn_the_axis(emulator, tmp_path):
    controller = GrblController(
        ControllerSettings(port=str(tmp_path / 'controller'), units_per_turn=-90.0)
    )
    controller.open()
    controller.move_to(math.pi / 2, *FAST)
    assert arrive(controller).position == pytest.approx(math.pi / 2, abs=1e-4)
    assert true_degrees(emulator) == pytest.approx(-22.5)
    controller.close()


def test_one_laser_at_a_time(controller, emulator):
    for name, lit in (('left', (1.0, 0.0)), ('right', (0.0, 1.0)), (None, (0.0, 0.0))):
        stamp_ns = controller.set_laser(name)
        outputs = emulator.machine.present_outputs()
        assert (outputs.spindle, outputs.coolant) == lit
        assert abs(time.time_ns() - stamp_ns) < 1e9
        assert [key for key, on in controller.poll().lasers.items() if on] == (
            [name] if name else []
        )


def test_power_of_the_spindle_laser(emulator, tmp_path):
    settings = ControllerSettings(
        port=str(tmp_path / 'controller'), lasers={'a': 'spindle'}, power=0.25
    )
    controller = GrblController(settings)
    controller.open()
    controller.set_laser('a')
    assert emulator.machine.present_outputs().spindle == pytest.approx(0.25)
    controller.close()


def test_laser_in_laser_mode_is_on_at_standstill(controller, emulator):
    emulator.machine.settings[32] = 1.0
    controller.set_laser('left')
    assert emulator.machine.present_outputs().spindle == 1.0


def test_laser_waits_for_the_end_of_the_motion(controller):
    controller.move_to(0.5, 0.5, 2 * math.pi)
    start = time.monotonic()
    controller.set_laser('left')
    assert time.monotonic() - start > 0.7
    assert not controller.poll().moving


def test_stop_brakes_turns_lasers_off_and_keeps_the_position(controller, emulator):
    controller.set_laser('left')
    controller.move_to(3.0, 1.0, 2 * math.pi)
    time.sleep(0.5)
    controller.stop()
    state = controller.poll()
    assert state.alarm is None
    assert not state.moving
    assert not any(state.lasers.values())
    assert emulator.machine.present_outputs().spindle == 0.0
    assert 0.2 < state.position < 1.5
    assert state.position == pytest.approx(math.radians(true_degrees(emulator)), abs=1e-4)


def test_stop_aborts_a_laser_that_waits(controller):
    controller.move_to(3.0, 0.5, 2 * math.pi)
    errors = []

    def switch():
        try:
            controller.set_laser('right')
        except DeviceError as error:
            errors.append(error)

    thread = threading.Thread(target=switch)
    thread.start()
    time.sleep(0.3)
    controller.stop()
    thread.join(timeout=2.0)
    assert [type(error) for error in errors] == [StoppedError]
    assert not any(controller.poll().lasers.values())


def test_new_move_replaces_the_old_one(controller):
    controller.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.3)
    controller.move_to(0.05, *FAST)
    assert arrive(controller).position == pytest.approx(0.05, abs=1e-4)


def test_restart_during_a_move_is_a_lost_position(controller, emulator):
    controller.set_laser('left')
    controller.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.3)
    emulator.fault('reset')
    until(lambda: controller.poll().alarm == 'POSITION_LOST')
    assert not any(controller.poll().lasers.values())
    with pytest.raises(ControllerAlarmError, match='POSITION_LOST'):
        controller.move_to(0.0, *FAST)
    controller.clear_alarm()
    controller.move_to(0.1, *FAST)
    assert arrive(controller).position == pytest.approx(0.1, abs=1e-4)


@pytest.mark.parametrize('number', [1, 3])
def test_alarm_locks_until_it_is_cleared(controller, emulator, number):
    emulator.fault(f'alarm {number}')
    until(lambda: controller.poll().alarm == f'ALARM_{number}')
    with pytest.raises(ControllerAlarmError):
        controller.set_laser('left')
    controller.clear_alarm()
    controller.set_laser('left')


def test_alarm_ends_a_command_that_waits(controller, emulator):
    controller.move_to(3.0, 0.5, 2 * math.pi)
    threading.Timer(0.3, emulator.fault, ['alarm 1']).start()
    with pytest.raises(ControllerAlarmError, match='limit switch'):
        controller.set_laser('left')


def test_silent_controller_is_lost_within_seconds(controller, emulator):
    emulator.fault('silence 60')
    start = time.monotonic()
    with pytest.raises(ControllerLostError):
        controller.set_laser('left')
    assert time.monotonic() - start < 5.0
    until(lambda: controller.poll().alarm == 'CONTROLLER_LOST')
    with pytest.raises(ControllerLostError):
        controller.move_to(1.0, *FAST)


def test_clear_alarm_connects_after_a_silence(controller, emulator):
    emulator.fault('silence 2')
    until(lambda: controller.poll().alarm == 'CONTROLLER_LOST')
    time.sleep(0.5)
    controller.clear_alarm()
    assert controller.poll().alarm is None


def test_unplugged_port_is_a_lost_controller(controller, emulator):
    emulator.fault('unplug')
    until(lambda: controller.poll().alarm == 'CONTROLLER_LOST')
    with pytest.raises(ControllerLostError):
        controller.stop()
    with pytest.raises(ControllerLostError, match='cannot be opened'):
        controller.clear_alarm()


def test_clear_alarm_connects_after_a_failed_attempt_and_replugging(emulator, tmp_path):
    port = tmp_path / 'port'
    port.symlink_to(tmp_path / 'controller')
    controller = GrblController(ControllerSettings(port=str(port)))
    controller.open()
    port.unlink()
    controller._set_lost('unplugged')
    for _ in range(2):
        # the second attempt said that clear_alarm has to be called, and did not open the port
        with pytest.raises(ControllerLostError, match='cannot be opened'):
            controller.clear_alarm()
        assert controller.poll().alarm == 'CONTROLLER_LOST'
    port.symlink_to(tmp_path / 'controller')
    controller.clear_alarm()
    assert controller.poll().alarm is None
    controller.close()


@pytest.mark.parametrize('error', [termios.error(5, 'Input/output error'), KeyError('unexpected')])
def test_open_that_fails_in_any_way_leaves_a_lost_controller(controller, monkeypatch, error):
    def fail(*_, **__):
        raise error

    controller._set_lost('unplugged')
    with monkeypatch.context() as patch:
        patch.setattr(serial, 'serial_for_url', fail)
        with pytest.raises((ControllerLostError, KeyError)):
            controller.clear_alarm()
    assert controller.poll().alarm == 'CONTROLLER_LOST'
    controller.clear_alarm()
    assert controller.poll().alarm is None


def test_controller_that_does_not_answer_a_stop_is_lost(controller, emulator):
    emulator.machine._report_status = lambda now: None
    emulator.machine._send_banner = lambda now: None
    with pytest.raises(ControllerLostError, match='reset'):
        controller.stop()
    assert controller.poll().alarm == 'CONTROLLER_LOST'


def test_silent_controller_is_reset_so_that_its_laser_goes_off(controller, emulator):
    controller.set_laser('right')
    start = time.monotonic()
    emulator.fault('silence 60')
    until(lambda: controller.poll().alarm == 'CONTROLLER_LOST')
    until(lambda: emulator.machine.present_outputs().coolant == 0.0)
    assert time.monotonic() - start < 1.0


def test_noise_is_ignored(controller, emulator):
    for _ in range(20):
        emulator.fault('noise')
        controller.set_laser('left')
        controller.set_laser(None)
    assert controller.poll().alarm is None


def test_move_whose_response_is_lost_is_sent_again(controller, emulator):
    send = emulator.machine._send
    lost = []

    def lose_first_ok(text):
        if text == 'ok\r\n' and not lost:
            lost.append(text)
        else:
            send(text)

    emulator.machine._send = lose_first_ok
    start = time.monotonic()
    controller.move_to(0.2, *FAST)
    assert lost
    assert time.monotonic() - start < 4.0
    assert arrive(controller).position == pytest.approx(0.2, abs=1e-4)


def test_lost_bytes_are_recovered_or_raise(controller, emulator):
    emulator.fault('drop 0.003')
    deadline = time.monotonic() + 20.0
    for step in range(20):
        try:
            controller.move_to(0.02 * step, *FAST)
            controller.set_laser('left' if step % 2 else None)
        except DeviceError:
            emulator.fault('drop 0')
            controller.clear_alarm()
            emulator.fault('drop 0.003')
    emulator.fault('drop 0')
    if controller.poll().alarm is not None:
        controller.clear_alarm()
    arrive(controller)
    assert time.monotonic() < deadline
    assert controller.poll().position == pytest.approx(
        math.radians(true_degrees(emulator)), abs=1e-3
    )


def test_output_that_is_on_without_command_is_an_alarm(controller, emulator):
    emulator.machine._modal_state.coolant = 'M8'
    emulator.machine._formatter.include_outputs()
    until(lambda: controller.poll().alarm == 'LASER_UNEXPECTED')
    assert controller.poll().lasers == {'left': False, 'right': True}


def test_home_defines_the_position(tmp_path):
    emulator = ControllerEmulator(tmp_path / 'controller', homing=True)
    emulator.machine.settings[25] = 36000.0
    emulator.machine.settings[110] = 36000.0
    emulator.machine.settings[120] = 3600.0
    emulator.start()
    controller = GrblController(
        ControllerSettings(port=str(tmp_path / 'controller'), lasers={'a': 'coolant'})
    )
    controller.open()
    assert controller.poll().alarm == 'LOCKED'
    with pytest.raises(ControllerAlarmError):
        controller.move_to(1.0, *FAST)
    controller.home()
    assert controller.poll().alarm is None
    # a degree before the switch; the count of turns is arbitrary
    home = math.degrees(controller.poll().position)
    assert (home + 1.0) % 360 == pytest.approx(0.0, abs=0.01) or home == pytest.approx(-1.0)
    controller.set_laser('a')
    controller.close()
    emulator.stop()


def test_home_without_a_switch_is_refused(controller):
    with pytest.raises(ControllerRefusedError, match=r'\$22'):
        controller.home()


def test_acceleration_is_written_only_when_it_differs(controller, emulator):
    emulator.machine.settings[120] = 360.0
    written = []
    write = emulator.machine._change_setting
    emulator.machine._change_setting = lambda *pair: written.append(pair) or write(*pair)
    controller.move_to(0.01, 1.0, 2 * math.pi)
    arrive(controller)
    controller.move_to(0.02, 1.0, math.pi)
    arrive(controller)
    controller.move_to(0.03, 1.0, math.pi)
    assert written == [('120', 180.0)]


def test_close_turns_lasers_off_and_stops(emulator, tmp_path):
    controller = GrblController(
        ControllerSettings(port=str(tmp_path / 'controller'), lasers={'a': 'coolant'})
    )
    controller.open()
    controller.set_laser('a')
    controller.move_to(3.0, 0.5, 2 * math.pi)
    time.sleep(0.2)
    controller.close()
    assert emulator.machine.present_outputs().coolant == 0.0
    assert not emulator.machine.axis.moving


def test_missing_port_is_refused(tmp_path):
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'none')))
    with pytest.raises(ControllerLostError, match='none'):
        controller.open()
    controller.close()


def test_port_in_use_is_refused(controller, tmp_path):
    other = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    with pytest.raises(ControllerLostError, match='cannot be opened'):
        other.open()


def test_unknown_laser_is_refused(controller):
    with pytest.raises(ParameterError, match='left, right'):
        controller.set_laser('middle')


@pytest.mark.parametrize(
    'motion', [(math.nan, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, -1.0), (1.0, math.inf, 1.0)]
)
def test_motion_out_of_range_is_refused(controller, motion):
    with pytest.raises(ParameterError):
        controller.move_to(*motion)


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
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ParameterError):
        ControllerSettings(port='x', **wrong)


def lose_bytes(emulator, pattern, replacement, count=1):
    """Damage the next ``count`` outputs of the controller that contain ``pattern``."""
    write, left = emulator._write, [count]

    def damaged(output):
        if left[0] and re.search(pattern, output):
            left[0] -= 1
            output = re.sub(pattern, replacement, output)
        write(output)

    emulator._write = damaged


def test_setting_that_lost_a_byte_is_read_again(emulator, tmp_path):
    lose_bytes(emulator, rb'\$110=7200.000', b'$110=720.000')
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    controller.open()
    assert controller.limits().velocity == pytest.approx(math.radians(7200 / 60))
    controller.close()


def test_settings_that_differ_in_every_listing_are_refused(emulator, tmp_path):
    numbers, send = iter(range(100, 200)), emulator.machine._send
    emulator.machine._send = lambda text: send(
        re.sub('110=7200', lambda _: f'110={next(numbers)}', text)
    )
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    with pytest.raises(ControllerLostError, match=r'\$110 .*differently'):
        controller.open()
    controller.close()


def test_position_that_lost_a_byte_moves_nothing(controller, emulator):
    controller.move_to(math.radians(123), *FAST)
    arrive(controller)
    # until the standstill was reported, too
    time.sleep(0.6)
    seen = []
    lose_bytes(emulator, rb'MPos:123.000', b'MPos:13.000')
    end = time.monotonic() + 0.8
    while time.monotonic() < end:
        seen.append(math.degrees(controller.poll().position))
        time.sleep(0.005)
    assert np.ptp(seen) < 0.1
    assert controller.poll().alarm is None


def test_damaged_position_before_a_move_adds_no_turns(controller, emulator):
    controller.move_to(math.radians(10), *FAST)
    arrive(controller)
    lose_bytes(emulator, rb'MPos:10.000', b'MPos:710.000', count=1)
    time.sleep(0.3)
    controller.move_to(math.radians(20), *FAST)
    assert math.degrees(arrive(controller).position) == pytest.approx(20, abs=0.01)
    assert true_degrees(emulator) == pytest.approx(20, abs=0.01)


def test_joined_lines_are_not_read_as_one(controller, emulator):
    emulator.fault('join 0.2')
    positions = []
    controller.move_to(2.0, 1.0, 2 * math.pi)
    while controller.poll().moving:
        positions.append(controller.poll().position)
        time.sleep(0.005)
    emulator.fault('join 0')
    assert np.diff(positions).min() > -0.02
    assert math.degrees(arrive(controller).position) == pytest.approx(
        true_degrees(emulator), abs=0.01
    )
    assert controller.poll().alarm is None


def test_restart_whose_banner_is_damaged_is_a_lost_position(controller, emulator):
    controller.move_to(math.radians(50), *FAST)
    arrive(controller)
    time.sleep(0.6)
    emulator.machine.banner = "\r\nGrl 1.1h ['$' for hlp]\r\n"
    emulator.fault('reset')
    until(lambda: controller.poll().alarm == 'POSITION_LOST')


def test_motion_that_differs_from_the_commanded_one_is_a_lost_position(controller, emulator):
    # the line lost a digit of the feed on its way to the controller
    queue = emulator.machine.axis.queue_move
    emulator.machine.axis.queue_move = lambda x, relative, feed: queue(x, relative, feed / 10)
    start = time.monotonic()
    controller.move_to(2.0, 0.5, 2 * math.pi)
    until(lambda: controller.poll().alarm == 'POSITION_LOST')
    assert time.monotonic() - start < 2.0


def test_acceleration_that_arrived_damaged_is_refused(controller, emulator):
    change = emulator.machine._change_setting
    emulator.machine._change_setting = lambda number, value: change(number, value / 10)
    with pytest.raises(ControllerRefusedError, match=r'reads back 18\.000'):
        controller.move_to(0.1, 1.0, math.pi)


@pytest.mark.parametrize('target', [0.5, -2.0])
def test_controller_that_reports_inches_is_understood(emulator, tmp_path, target):
    emulator.machine.settings[13] = 1
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    controller.open()
    controller.move_to(target, *FAST)
    arrive(controller)
    time.sleep(0.6)
    state = controller.poll()
    assert (state.alarm, state.reported) == (None, pytest.approx(target, abs=1e-4))
    assert math.radians(true_degrees(emulator)) == pytest.approx(target, abs=1e-4)
    controller.close()


def test_reports_that_contradict_the_unit_setting_are_refused(emulator, tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.grbl.handshake.START_TIMEOUT', 0.5)
    emulator.machine.settings[13] = 1
    line = ReportFormatter.status_line
    monkeypatch.setattr(
        ReportFormatter, 'status_line', lambda self, **v: line(self, **{**v, 'inches': False})
    )
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    with pytest.raises(ControllerRefusedError, match=r'\$13=1.*MPos'):
        controller.open()


@pytest.mark.parametrize(
    ('banner', 'said'),
    [
        ('start\r\necho:Marlin 2.1\r\n', "'start', 'echo:Marlin 2.1'"),
        ('\x80\x81\x82', 'baud rate'),
        ('', 'nothing was received'),
    ],
)
def test_controller_of_another_protocol_is_named(emulator, tmp_path, monkeypatch, banner, said):
    monkeypatch.setattr('ivfmc_ros.devices.grbl.handshake.START_TIMEOUT', 0.3)
    monkeypatch.setattr('ivfmc_ros.devices.grbl.handshake._AUTO_RESET_TIMEOUT', 0.5)
    machine = emulator.machine
    machine._send_banner = lambda now: machine._tx.extend(banner.encode('latin-1'))
    machine._report_status = lambda now: None
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    with pytest.raises(ControllerLostError, match=re.escape(said)):
        controller.open()


def test_controller_that_restarts_while_it_is_connected_is_lost_or_connected(emulator, tmp_path):
    controller = GrblController(ControllerSettings(port=str(tmp_path / 'controller')))
    restarted = []

    def restart_once(command, now, execute=emulator.machine._execute_system_command):
        execute(command, now)
        if command == '$' and not restarted:
            restarted.append(True)
            time.sleep(0.4)
            emulator.machine.power_on(time.monotonic())

    emulator.machine._execute_system_command = restart_once
    with pytest.raises(ControllerAlarmError, match='restarted'):
        controller.open()
    assert controller.poll().alarm == 'CONTROLLER_LOST'
    controller.clear_alarm()
    assert controller.poll().alarm is None
    controller.close()


def test_own_process_that_was_stopped_is_no_silence_of_the_controller(controller, monkeypatch):
    until(lambda: controller.poll().reported_ns)
    # after the last report, a query was sent as late as if the process had been stopped
    late = time.monotonic() + 1.5
    monitor = controller._monitor
    with monitor._changed:
        monkeypatch.setattr(time, 'monotonic', lambda: late)
        monitor.query_due()
        assert not monitor.is_silent
