# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion controller of any known firmware, which is set or found out when it is connected."""

from collections.abc import Mapping
import time

from ivfmc_ros.devices.controller import AxisLimits
from ivfmc_ros.devices.controller import CONTROLLER_LOST
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import NOT_CONNECTED
from ivfmc_ros.devices.controller import OffLine
from ivfmc_ros.devices.controller import SerialController
from ivfmc_ros.devices.detection import detect
from ivfmc_ros.devices.fabscan.controller import FabscanController
from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.marlin.controller import MarlinController
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.errors import ControllerLostError

_AUTO = 'auto'
_CONSTRUCTORS: dict[str, type[GrblController | MarlinController | FabscanController]] = {
    **dict.fromkeys(('grbl', 'grblhal', 'fluidnc', 'horus'), GrblController),
    'marlin': MarlinController,
    'fabscan': FabscanController,
}


class AnyController:
    """
    A MotionController that hands all calls to the driver of the firmware; see there.

    Where ``settings.firmware`` is auto, ``open`` asks the controller, and a controller that is
    connected again may run another firmware than before.
    """

    def __init__(self, settings: ControllerSettings) -> None:
        self._settings = settings
        self._power = settings.power
        self._driver: SerialController | None = None
        if settings.firmware != _AUTO:
            self._driver = _CONSTRUCTORS[settings.firmware](settings)

    def open(self) -> None:
        """
        Connect, wait until the controller has started, turn the lasers off.

        :raises ControllerLostError: the port cannot be opened, or no known firmware answers
        """
        if self._settings.firmware == _AUTO:
            if self._driver is not None:
                self._driver.close()
            opened = detect(self._settings.port, self._settings.baud)
            constructor = _CONSTRUCTORS[opened.firmware]
            if not isinstance(self._driver, constructor):
                self._driver = constructor(self._settings)
                self._driver.set_power(self._power)
            self._driver.adopt(opened.port, opened.received)
        self._required().open()

    def close(self) -> None:
        """Turn the lasers off, stop, and disconnect; raises nothing."""
        if self._driver is not None:
            self._driver.close()

    def home(self) -> None:
        """Search the home switch; return when the axis is there."""
        self._required().home()

    def stop(self) -> None:
        """Brake and turn the lasers off."""
        self._required().stop()

    def clear_alarm(self) -> None:
        """Unlock after an alarm, or connect again."""
        if self._driver is None or self.poll().alarm == CONTROLLER_LOST:
            self.open()
        self._required().clear_alarm()

    def move_to(self, position: float, velocity: float, acceleration: float) -> None:
        """Begin a move that ends in standstill."""
        self._required().move_to(position, velocity, acceleration)

    def set_laser(self, name: str | None) -> int:
        """Turn one laser on and all others off; None turns all off."""
        return self._required().set_laser(name)

    def set_power(self, power: float) -> None:
        """Set the power of lasers that can be dimmed, 0 to 1."""
        self._power = power
        if self._driver is not None:
            self._driver.set_power(power)

    def poll(self) -> ControllerState:
        """Return the last known state without waiting."""
        if self._driver is not None:
            return self._driver.poll()
        now_ns = time.time_ns()
        return ControllerState(
            stamp_ns=now_ns,
            position=0.0,
            velocity=0.0,
            reported=0.0,
            reported_ns=now_ns,
            moving=False,
            alarm=CONTROLLER_LOST,
            lasers=dict.fromkeys(self._settings.lasers, False),
            lasers_ns=0,
        )

    def unknown_lines(self) -> Mapping[str, int]:
        """Return how many lines of each kind the driver did not understand."""
        return self._driver.unknown_lines() if self._driver is not None else {}

    def limits(self) -> AxisLimits:
        """Return the limits of the axis."""
        return self._required().limits()

    def off_line(self) -> OffLine | None:
        """Return how another process can turn the outputs off."""
        return self._driver.off_line() if self._driver is not None else None

    def _required(self) -> SerialController:
        if self._driver is None:
            raise ControllerLostError(f'port {self._settings.port}: {NOT_CONNECTED}')
        return self._driver
