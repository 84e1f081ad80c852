# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Driver of the turntable: a motion controller, its connection, and the laser interlock."""

from collections.abc import Callable
from collections.abc import Mapping
import contextlib
import math
import threading
import time

from ivfmc_ros.devices.beam import Beam
from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import MotionController
from ivfmc_ros.devices.guard.beam_guard import BeamGuard
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError

_INTERLOCK_PERIOD = 0.02  # seconds between evaluations of the interlock
# ... while no laser is on or wanted, and the table stands; a request is evaluated at once
_REST_PERIOD = 0.1
_RETRY_PERIOD = 2.0  # seconds between attempts to stop a controller that failed to
# Seconds from a failed attempt to connect to the next one: the pause doubles each time.
_FIRST_DELAY, _MAX_DELAY = 0.5, 5.0
# Seconds that a round of the watchdog, an attempt to connect, and an emergency stop may take until
# the guard of the beam takes the watchdog for hung. A stop brakes for up to 4 s with the beam on.
_WATCHDOG_TIME, _CONNECT_TIME, _STOP_TIME = 0.25, 30.0, 5.0
_MIN_DISTANCE = 1e-6  # radians; a shorter move has no duration to keep
_LASER_OFF_TIMEOUT = 2.0  # seconds that a move waits until a laser has gone off
_POLL_PERIOD = 0.005  # seconds between looks at the lasers during that


class TurntableDriver:
    """
    Connects to a motion controller, and switches its lasers as the interlock decides.

    Three threads: the watchdog evaluates the interlock 50 times a second (10 times while the cell
    is dark and stands), connects, and stops a moving table whose laser must go off; the switching
    thread turns lasers on and off, which on many controllers blocks until a motion has ended; the
    motion thread sends moves.

    fault : why the controller cannot be reached or did not switch a laser, '' if there is none
    rejection : why the controller did not accept the last move, '' if it did
    """

    def __init__(
        self,
        controller: MotionController,
        interlock: BeamInterlock,
        *,
        velocity: float,
        reconnect: bool = False,
        guard: BeamGuard | None = None,
    ) -> None:
        """
        Make a driver that is not connected; ``start`` connects.

        velocity : rad/s, limit of all moves, and the speed of moves without a duration
        reconnect : connect again to a controller that was lost; otherwise ``clear_alarm`` does
        guard : process that turns the lasers off when this one dies or hangs
        """
        self._controller, self._interlock, self._velocity = controller, interlock, velocity
        self._closing = threading.Event()
        self._interlock_changed = threading.Event()
        self._connected = False
        self._connection_lock = threading.Lock()
        self._reconnect, self._guard = reconnect, guard
        self._alive_until = 0.0  # steady second until which the watchdog is taken to run
        self._delay = _FIRST_DELAY
        self._wanted_laser: str | None = None
        self._laser_wanted = threading.Condition()
        self._target: tuple[float, float] | None = None
        self._target_changed = threading.Condition()
        self._threads: list[threading.Thread] = []
        self.fault = 'not connected yet'
        self.rejection = ''

    def start(self) -> None:
        """Start the threads; the watchdog connects, and tries again until it succeeds."""
        self._closing.clear()
        for function in (self._run_watchdog, self._run_switching, self._run_motion):
            thread = threading.Thread(
                target=self._restart_on_error,
                args=(function,),
                name=function.__name__,
                daemon=True,
            )
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """Turn the lasers off, stop the table, disconnect; may be called again."""
        self._closing.set()
        self._controller.close()
        for thread in self._threads:
            thread.join()
        self._threads.clear()
        if self._connected:
            # the watchdog connected while the controller was being closed
            self._controller.close()
        self._connected = False
        self._end_guard()

    def adjust(
        self, settings: BeamSettings, velocity: float, power: float, *, reconnect: bool
    ) -> None:
        """
        Change limits while the driver runs.

        velocity : rad/s
        power : 0 to 1, applies when a laser is turned on next
        """
        self._interlock.settings, self._velocity = settings, velocity
        self._reconnect = reconnect
        self._controller.set_power(power)

    def state(self) -> ControllerState:
        """Return the last known state without waiting."""
        return self._controller.poll()

    @property
    def guard_fault(self) -> str:
        """Why no process guards the beam, '' if one does or none is wanted."""
        return '' if self._guard is None else self._guard.fault

    @property
    def guard_action(self) -> str:
        """What the guard of the beam did since the last laser was turned on, '' for nothing."""
        return '' if self._guard is None else self._guard.action

    def unknown_lines(self) -> Mapping[str, int]:
        """Return how many lines of each kind the driver of the controller did not understand."""
        return self._controller.unknown_lines()

    def command(self, position: float, seconds: float) -> None:
        """
        Queue a move and return at once; it replaces a move that was not sent yet.

        If the controller does not accept it, ``rejection`` says why.

        position : radians, unwrapped
        seconds : duration of the move, 0 for as fast as allowed; limits may make it longer
        :raises ParameterError: a number is not finite, or the duration is negative
        """
        if not (math.isfinite(position) and math.isfinite(seconds) and seconds >= 0.0):
            raise ParameterError(
                f'position {position}, seconds {seconds}: must be finite, seconds not negative'
            )
        with self._target_changed:
            self._target = position, seconds
            self._target_changed.notify_all()

    def go_to(self, position: float, seconds: float) -> None:
        """
        Begin a move that ends in standstill; return when the controller has accepted it.

        position, seconds : as in ``command``
        :raises DeviceError: the controller did not accept it
        """
        self._interlock.end_manual()
        self._wait_for_laser_off()
        if self._guard is not None:
            self._guard.announce()
        limits = self._controller.limits()
        speed = min(self._velocity, limits.velocity)
        distance = abs(position - self._controller.poll().position)
        if seconds > 0.0 and distance > _MIN_DISTANCE:
            speed = min(speed, trajectory.cruise_speed(distance, seconds, limits.acceleration))
        self._controller.move_to(position, speed, limits.acceleration)

    def _wait_for_laser_off(self) -> None:
        """Wait for a laser that must go off: the watchdog would stop the table during the move."""
        end = time.monotonic() + _LASER_OFF_TIMEOUT
        while self._interlock.decide().laser is None and time.monotonic() < end:
            state = self._controller.poll()
            if state.moving or state.alarm is not None or state.active_laser is None:
                return
            self._closing.wait(_POLL_PERIOD)

    def hold(self, laser: str) -> None:
        """
        Keep one laser on for another ``hold_timeout``; '' for none.

        :raises ParameterError: there is no such laser
        """
        try:
            self._interlock.hold(laser)
        finally:
            self._interlock_changed.set()

    def permit(self, allowed: bool) -> None:
        """Grant the permit for lasers, or withdraw it."""
        self._interlock.permit(allowed)
        self._interlock_changed.set()

    def home(self) -> None:
        """
        Home the table, which finds its position again.

        :raises DeviceError: the controller cannot home
        """
        self._interlock.end_manual()
        self._controller.home()

    def stop(self) -> None:
        """
        Brake and turn the lasers off; they stay off until beam_hold has ended once.

        :raises DeviceError: the controller did not stop
        """
        with self._target_changed:
            self._target = None
        self._interlock.block()
        self._controller.stop()

    def clear_alarm(self) -> None:
        """
        Unlock the controller after an alarm; connect again if it was lost.

        :raises DeviceError: the controller stays locked or lost
        """
        self._interlock.block()
        with self._connection_lock:
            connected = self._connected and self._controller.poll().alarm != CONTROLLER_LOST
            if not connected:
                self._end_guard()
            self._controller.clear_alarm()
            if not connected:
                self._set_connected()

    def enable(self, name: str, on: bool) -> None:
        """
        Turn a laser on or off by a manual request; return when it is done.

        :raises BusyError: the cell is not idle, or there is no permit
        :raises ParameterError: there is no such laser
        :raises DeviceError: the controller did not switch it
        """
        self._interlock.enable(name, on, self._controller.poll().moving)
        laser = self._interlock.decide().laser
        with self._laser_wanted:
            self._wanted_laser = laser
        self._interlock_changed.set()
        self._set_laser(laser)

    # -- threads

    def _restart_on_error(self, function: Callable[[], None]) -> None:
        """Run a thread's function again after any error: without watchdog, a laser stays on."""
        while not self._closing.is_set():
            try:
                function()
            except Exception as error:
                self.fault = f'{type(error).__name__}: {error}'
                self._closing.wait(_INTERLOCK_PERIOD)

    def _run_watchdog(self) -> None:
        retry_at, period = 0.0, _INTERLOCK_PERIOD
        while not self._closing.is_set():
            self._interlock_changed.wait(period)
            self._interlock_changed.clear()
            now = time.monotonic()
            self._alive_until = now + _WATCHDOG_TIME
            if not self._connected:
                if now >= retry_at:
                    self._alive_until = now + _CONNECT_TIME
                    self._connect()
                    retry_at = time.monotonic() + self._next_delay()
                continue
            if self._is_to_reconnect():
                self._connected, retry_at = False, now + self._next_delay()
                continue
            beam, state = self._interlock.decide(), self._controller.poll()
            with self._laser_wanted:
                self._wanted_laser = beam.laser
                if beam.laser != state.active_laser:
                    self._laser_wanted.notify_all()
            is_dark = beam.laser is None and not any(state.lasers.values())
            period = _REST_PERIOD if is_dark and not state.moving else _INTERLOCK_PERIOD
            if self._must_stop(beam, state) and now >= retry_at:
                if state.alarm is None:
                    self._interlock.interrupt()
                    self.rejection = (
                        f'the table was stopped in a move, because its laser had to go off: '
                        f'{beam.reason}'
                    )
                self._alive_until = now + _STOP_TIME
                retry_at = now + (0.0 if self._emergency_stop() else _RETRY_PERIOD)

    @staticmethod
    def _must_stop(beam: Beam, state: ControllerState) -> bool:
        """Return whether a laser is on that the switching thread cannot turn off in time."""
        laser_on = any(state.lasers.values())
        if state.alarm is not None:
            return laser_on and state.alarm not in (CONTROLLER_LOST, CONNECTING)
        # at standstill the switching thread turns the laser off at once
        return laser_on and beam.urgent and state.moving

    def _connect(self) -> None:
        with self._connection_lock:
            if self._connected:
                return  # clear_alarm was faster
            self._end_guard()
            try:
                self._controller.open()
            except DeviceError as error:
                self.fault = str(error)
            else:
                self._set_connected()

    def _set_connected(self) -> None:
        self.fault, self._delay, self._connected = '', _FIRST_DELAY, True
        if self._guard is not None:
            self._guard.start(self._controller.off_line(), self._is_alive, self._may_be_lit)

    def _end_guard(self) -> None:
        """End the guard process, which keeps the port locked: its controller is lost."""
        if self._guard is not None:
            self._guard.end()

    def _is_to_reconnect(self) -> bool:
        """Return whether the controller was lost; what was requested before is forgotten then."""
        if not self._reconnect or self._controller.poll().alarm != CONTROLLER_LOST:
            return False
        self._interlock.block()
        with self._target_changed:
            self._target = None
        return True

    def _next_delay(self) -> float:
        """Return the seconds until the next attempt to connect."""
        delay, self._delay = self._delay, min(2 * self._delay, _MAX_DELAY)
        return delay

    def _set_laser(self, name: str | None) -> None:
        if name is not None and self._guard is not None:
            self._guard.announce()
        self._controller.set_laser(name)
        if name is not None and self._guard is not None:
            self._guard.forgive()

    def _is_alive(self) -> bool:
        return time.monotonic() < self._alive_until

    def _may_be_lit(self) -> bool:
        """Return whether a laser may be on, or the table moves."""
        state = self._controller.poll()
        return self._wanted_laser is not None or state.moving or any(state.lasers.values())

    def _emergency_stop(self) -> bool:
        """Stop the controller; return whether it did."""
        try:
            self._controller.stop()
        except DeviceError as error:
            self.fault = str(error)
            return False
        return True

    def _run_motion(self) -> None:
        while not self._closing.is_set():
            with self._target_changed:
                self._target_changed.wait_for(lambda: self._target is not None, _REST_PERIOD)
                target, self._target = self._target, None
            if target is None:
                continue
            try:
                self.go_to(*target)
                self.rejection = ''
            except DeviceError as error:
                self.rejection = str(error)

    def _run_switching(self) -> None:
        while not self._closing.is_set():
            with self._laser_wanted:
                wanted, state = self._wanted_laser, self._controller.poll()
                is_switched = wanted == state.active_laser
                # a controller switches at the end of a motion; until then another may be wanted
                ready = self._connected and state.alarm is None and not state.moving
                if is_switched or not ready:
                    # the watchdog notifies where the lasers are not as wanted
                    self._laser_wanted.wait(_REST_PERIOD if is_switched else _INTERLOCK_PERIOD)
                    continue
            try:
                self._set_laser(wanted)
                self.fault = ''
            except StoppedError:
                pass  # the stop turned all lasers off
            except DeviceError as error:
                self.fault = str(error)
                # a laser that could not be turned off is turned off by a reset
                if wanted is None:
                    with contextlib.suppress(DeviceError):
                        self._controller.stop()
                self._closing.wait(_INTERLOCK_PERIOD)
