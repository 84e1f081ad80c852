# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Driver of the turntable: a motion controller, its connection, and the laser interlock."""

from collections.abc import Callable
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
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError

_INTERLOCK_PERIOD = 0.02  # seconds between evaluations of the interlock
_RETRY_PERIOD = 2.0  # seconds between attempts to connect, or to stop a controller that failed to
_MIN_DISTANCE = 1e-6  # radians; a shorter move has no duration to keep
_LASER_OFF_TIMEOUT = 2.0  # seconds that a move waits until a laser has gone off
_POLL_PERIOD = 0.005  # seconds between looks at the lasers during that


class TurntableDriver:
    """
    Connects to a motion controller, and switches its lasers as the interlock decides.

    Three threads: the watchdog evaluates the interlock 50 times a second, connects, and stops a
    moving table whose laser must go off; the switching thread turns lasers on and off, which on
    many controllers blocks until a motion has ended; the motion thread sends moves.

    fault : why the controller cannot be reached or did not switch a laser, '' if there is none
    rejection : why the controller did not accept the last move, '' if it did
    """

    def __init__(
        self, controller: MotionController, interlock: BeamInterlock, *, velocity: float
    ) -> None:
        """
        Make a driver that is not connected; ``start`` connects.

        velocity : rad/s, limit of all moves, and the speed of moves without a duration
        """
        self._controller, self._interlock, self._velocity = controller, interlock, velocity
        self._closing = threading.Event()
        self._interlock_changed = threading.Event()
        self._connected = False
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

    def adjust(self, settings: BeamSettings, velocity: float, power: float) -> None:
        """
        Change limits while the driver runs.

        velocity : rad/s
        power : 0 to 1, applies when a laser is turned on next
        """
        self._interlock.settings, self._velocity = settings, velocity
        self._controller.set_power(power)

    def state(self) -> ControllerState:
        """Return the last known state without waiting."""
        return self._controller.poll()

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
        limits = self._controller.limits()
        speed = min(self._velocity, limits.velocity)
        distance = abs(position - self._controller.poll().position)
        if seconds > 0.0 and distance > _MIN_DISTANCE:
            speed = min(speed, cruise_speed(distance, seconds, limits.acceleration))
        self._controller.move_to(position, speed, limits.acceleration)

    def _wait_for_laser_off(self) -> None:
        """Wait for a laser that must go off: the watchdog would stop the table during the move."""
        end = time.monotonic() + _LASER_OFF_TIMEOUT
        while self._interlock.decide().laser is None and time.monotonic() < end:
            state = self._controller.poll()
            if state.moving or state.alarm is not None or active_laser(state) is None:
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
        self._controller.clear_alarm()
        self._connected = True

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
        self._controller.set_laser(laser)

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
        retry_at = 0.0
        while not self._closing.is_set():
            self._interlock_changed.wait(_INTERLOCK_PERIOD)
            self._interlock_changed.clear()
            now = time.monotonic()
            if not self._connected:
                if now >= retry_at:
                    self._connect()
                    retry_at = time.monotonic() + _RETRY_PERIOD
                continue
            beam, state = self._interlock.decide(), self._controller.poll()
            with self._laser_wanted:
                self._wanted_laser = beam.laser
                self._laser_wanted.notify_all()
            if self._must_stop(beam, state) and now >= retry_at:
                if state.alarm is None:
                    self._interlock.interrupt()
                    self.rejection = (
                        f'the table was stopped in a move, because its laser had to go off: '
                        f'{beam.reason}'
                    )
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
        try:
            self._controller.open()
        except DeviceError as error:
            self.fault = str(error)
        else:
            self.fault, self._connected = '', True

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
                self._target_changed.wait_for(lambda: self._target is not None, _INTERLOCK_PERIOD)
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
                self._laser_wanted.wait(_INTERLOCK_PERIOD)
                wanted = self._wanted_laser
            state = self._controller.poll()
            ready = self._connected and state.alarm is None
            if not ready or wanted == active_laser(state):
                continue
            try:
                self._controller.set_laser(wanted)
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


def active_laser(state: ControllerState) -> str | None:
    """Return the name of the laser that is on; '' if several are, None if none is."""
    on = [name for name, is_on in state.lasers.items() if is_on]
    return None if not on else on[0] if len(on) == 1 else ''


def cruise_speed(distance: float, seconds: float, acceleration: float) -> float:
    """
    Return the speed at which a trapezoidal move of ``distance`` takes ``seconds``.

    Solves v^2 - a t v + a d = 0 for the smaller v, in the form without cancellation.

    distance, acceleration : radians and rad/s^2, not negative
    :returns: rad/s, infinite if no speed is high enough
    """
    discriminant = (acceleration * seconds) ** 2 - 4 * acceleration * distance
    if discriminant < 0.0:
        return math.inf
    return 2 * distance / (seconds + math.sqrt(discriminant) / acceleration)
