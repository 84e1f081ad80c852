# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Common part of the drivers of controllers with a prompt: state, connection, laser switching."""

from abc import ABC
from abc import abstractmethod
from collections.abc import Mapping
import contextlib
from dataclasses import replace
import threading
import time

import serial

from ivfmc_ros.devices.controller import AxisLimits
from ivfmc_ros.devices.controller import CONNECTING
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import NOT_CONNECTED
from ivfmc_ros.devices.controller import OffLine
from ivfmc_ros.devices.controller import POSITION_LOST
from ivfmc_ros.devices.controller import require_laser
from ivfmc_ros.devices.controller import require_motion
from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.axis_units import AUTO_AXIS
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.motion.position_estimator import PositionEstimator
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.devices.prompt.prompt_line import PromptLine
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.devices.unknown_lines import UnknownLines
from ivfmc_ros.errors import ControllerAlarmError
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import StoppedError

_PERIOD = 0.01  # seconds between looks whether a motion has ended


class PromptController(ABC):
    """
    A MotionController behind a prompt; see there for its methods.

    A thread of its own asks for the position, or counts it. Positions are unwrapped controller
    units inside; the state is guarded by ``_changed``, commands by ``_command_lock``.
    """

    # Outputs by name: commands (on, off); {power} is 0 to 255.
    OUTPUTS: Mapping[str, tuple[str, str]]
    OFF_STEPS: tuple[tuple[bytes, float], ...]

    def __init__(self, settings: ControllerSettings) -> None:
        self._settings = settings
        axis = 'X' if settings.axis == AUTO_AXIS else settings.axis
        self._units = AxisUnits(axis, settings.units_per_turn)
        self._line = PromptLine(
            is_end=self._is_end,
            is_busy=self._is_busy,
            on_other=self._handle_line,
            on_lost=self._set_lost,
        )
        self._command_lock = threading.RLock()
        self._changed = threading.Condition(threading.RLock())
        self._unknown = UnknownLines()
        self._estimator = PositionEstimator()
        self._reported, self._reported_ns = 0.0, 0
        self._lasers = dict.fromkeys(settings.lasers, False)
        self._lasers_ns = 0
        self._alarm: str | None = CONTROLLER_LOST
        self._homed = False
        self._firmware = ''
        self._limits = (0.0, 0.0)  # units per second, units per second squared
        self._moves = 0  # count of moves and stops; a step of an earlier one is not done
        self._ending = threading.Event()
        self._worker: threading.Thread | None = None

    # -- what differs

    @abstractmethod
    def _is_end(self, text: str) -> bool:
        """Return whether a line ends an answer."""

    @abstractmethod
    def _is_busy(self, text: str) -> bool:
        """Return whether a line says that the controller is at work."""

    @abstractmethod
    def _handle_line(self, text: str) -> None:
        """Evaluate any line, in the reading thread."""

    @abstractmethod
    def _connect(self) -> None:
        """Wait for the start, read firmware, limits and position."""

    @abstractmethod
    def _begin(self, target: float, velocity: float, acceleration: float) -> None:
        """Begin a move to ``target``, unwrapped units; velocities are units per second."""

    @abstractmethod
    def _halt(self) -> None:
        """End the motion; return when the axis stands."""

    @abstractmethod
    def _work(self) -> None:
        """Do what is due in the thread: ask for the position, or send the next step."""

    # -- MotionController

    def open(self) -> None:
        """
        Connect, wait until the controller has started, turn the lasers off.

        :raises ControllerLostError: the port cannot be opened, or the controller does not answer
        :raises ControllerRefusedError: it does not have the axis, or an output
        """
        with self._command_lock:
            self._end_worker()
            self._line.serial.close()
            with self._changed:
                self._alarm, self._homed = CONNECTING, False
            try:
                self._line.open(self._settings.port, self._settings.baud)
                self._connect()
                self._require_outputs()
                self._switch(None)
                with self._changed:
                    if self._alarm != CONNECTING:
                        raise ControllerLostError(f'the connection was lost: {self._alarm}')
                    self._alarm = None
            except BaseException:
                self._line.serial.close()
                self._set_lost('')
                raise
            self._ending.clear()
            self._worker = threading.Thread(target=self._run, name='controller', daemon=True)
            self._worker.start()

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect."""
        with contextlib.suppress(DeviceError):
            self.stop()
        self._end_worker()
        self._line.close()
        self._set_lost('')

    def home(self) -> None:
        """
        Search the home switch.

        :raises ControllerRefusedError: the firmware cannot home
        """
        raise ControllerRefusedError(f'{self._firmware}: has no command to search a home switch')

    def stop(self) -> None:
        """
        Brake and turn the lasers off.

        :raises ControllerLostError: the controller is not connected
        """
        self._moves += 1
        if self._alarm == CONTROLLER_LOST:
            # it may still receive, though its answers do not arrive
            for data, _ in self.OFF_STEPS:
                self._line.serial.write(data)
            self._require_connected()
        self._halt()
        self._switch(None)

    def clear_alarm(self) -> None:
        """Accept the position, or connect again."""
        with self._command_lock:
            if self._alarm == CONTROLLER_LOST:
                self.open()
            else:
                self.stop()
            with self._changed:
                self._alarm, self._homed = None, True

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """
        Begin a move; a move in progress is ended first.

        :raises ParameterError: a number is not finite, or not positive
        :raises ControllerAlarmError: the controller is locked
        """
        require_motion(position, velocity, acceleration)
        with self._command_lock:
            self._require_ready()
            if self.poll().moving:
                self.stop()
                self._require_ready()
            self._moves += 1
            rate, limit = self._limits
            self._begin(
                self._units.from_radians(position),
                min(self._units.length(velocity), rate),
                min(self._units.length(acceleration), limit),
            )

    def set_laser(self, name: str | None) -> int:
        """
        Turn one laser on and all others off, at the end of a motion; None turns all off.

        :raises ParameterError: there is no such laser
        """
        require_laser(name, self._settings.lasers)
        number = self._moves
        # without the lock: a move or a stop goes first
        while self.poll().moving and self._alarm is None:
            time.sleep(_PERIOD)
            if number != self._moves:
                raise StoppedError('the motion was stopped')
        with self._command_lock:
            self._require_ready()
            return self._switch(name)

    def set_power(self, power: float) -> None:
        """Set the power of lasers that can be dimmed, 0 to 1, for the next turning on."""
        self._settings = replace(self._settings, power=power)

    def poll(self) -> ControllerState:
        """Return the last known state without waiting."""
        with self._changed:
            position, velocity = self._estimator.state_at(time.monotonic())
            radians = self._units.to_radians
            return ControllerState(
                stamp_ns=time.time_ns(),
                position=radians(position),
                velocity=radians(velocity) - radians(0.0),
                reported=radians(self._reported),
                reported_ns=self._reported_ns,
                moving=not self._estimator.standing,
                alarm=self._alarm,
                lasers=dict(self._lasers),
                lasers_ns=self._lasers_ns,
                homed=self._homed,
                firmware='' if self._alarm == CONTROLLER_LOST else self._firmware,
            )

    def limits(self) -> AxisLimits:
        """
        Return the limits of the axis.

        :raises ControllerLostError: the controller is not connected
        """
        self._require_connected()
        one = self._units.length(1.0)
        return AxisLimits(velocity=self._limits[0] / one, acceleration=self._limits[1] / one)

    def unknown_lines(self) -> Mapping[str, int]:
        """Return how many lines of each kind were not understood."""
        return self._unknown.counts()

    def adopt(self, port: serial.Serial, received: bytes) -> None:
        """Use an open port, from which bytes were received, for the next ``open``."""
        self._line.serial.adopt(port, received)

    def off_line(self) -> OffLine | None:
        """Return how another process can turn the outputs off; None while not connected."""
        handle = self._line.serial.handle
        return None if handle is None else OffLine(handle=handle, steps=self.OFF_STEPS)

    # -- steps

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                self._work()
            except ControllerLostError as error:
                self._set_lost(str(error))
            except DeviceError:
                pass  # a stop ended the request
            self._ending.wait(_PERIOD)

    def _end_worker(self) -> None:
        self._ending.set()
        worker, self._worker = self._worker, None
        if worker is not None and worker is not threading.current_thread():
            worker.join()

    def _switch(self, name: str | None) -> int:
        outputs = self._settings.lasers
        for laser, output in outputs.items():
            if laser != name:
                self._line.request(self.OUTPUTS[output][1])
        self._set_lasers(None)
        if name is not None:
            power = round(255 * self._settings.power)
            self._line.request(self.OUTPUTS[outputs[name]][0].format(power=power))
            self._set_lasers(name)
        return self._lasers_ns

    def _set_lasers(self, on: str | None) -> None:
        with self._changed:
            lasers = {name: name == on for name in self._settings.lasers}
            if lasers != self._lasers or not self._lasers_ns:
                self._lasers, self._lasers_ns = lasers, time.time_ns()

    def _plan(self, plan: Trajectory) -> None:
        """Note a motion that begins now."""
        with self._changed:
            self._estimator.begin(plan, time.monotonic())

    def _trapezoid(self, target: float, velocity: float, acceleration: float) -> Trajectory:
        start = self._estimator.target
        return trajectory.trapezoid(start, target, velocity, acceleration, 0.0)

    def _stand(self, units: float) -> None:
        """Note that the axis stands."""
        with self._changed:
            self._estimator.set_standstill(units)
            self._reported, self._reported_ns = units, time.time_ns()

    def _set_alarm(self, alarm: str) -> None:
        with self._changed:
            if self._alarm not in (CONTROLLER_LOST, CONNECTING):
                self._alarm, self._homed = alarm, False
                self._estimator.set_standstill(self._estimator.state_at(time.monotonic())[0])

    def _lose_position(self) -> None:
        self._set_alarm(POSITION_LOST)
        self._set_lasers(None)

    def _set_lost(self, reason: str) -> None:
        with self._changed:
            position = self._estimator.state_at(time.monotonic())[0]
            self._estimator.set_standstill(position)
            self._alarm, self._homed = CONTROLLER_LOST, False

    def _require_connected(self) -> None:
        if self._alarm in (CONTROLLER_LOST, CONNECTING):
            raise ControllerLostError(NOT_CONNECTED)

    def _require_ready(self) -> None:
        self._require_connected()
        if self._alarm is not None:
            raise ControllerAlarmError(
                f'the controller is locked: {self._alarm}; call home or clear_alarm'
            )

    def _require_outputs(self) -> None:
        for laser, output in self._settings.lasers.items():
            if output not in self.OUTPUTS:
                raise ControllerRefusedError(
                    f'laser_outputs: {output} of laser {laser}: the controller runs '
                    f'{self._firmware}, which has {", ".join(self.OUTPUTS)}'
                )
