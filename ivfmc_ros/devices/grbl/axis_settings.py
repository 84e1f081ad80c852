# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the axis that turns the table, as the controller states them."""

from ivfmc_ros.devices.controller import AxisLimits
from ivfmc_ros.devices.grbl.command_channel import CommandChannel
from ivfmc_ros.devices.grbl.dialects import ACCELERATION
from ivfmc_ros.devices.grbl.dialects import MAX_RATE
from ivfmc_ros.devices.grbl.handshake import Handshake
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError

_TOLERANCE = 1e-3  # relative; GRBL reports settings with three decimals


class AxisSettings:
    """Greatest rate and acceleration of the axis."""

    def __init__(
        self,
        units: AxisUnits,
        channel: CommandChannel,
        monitor: GrblMonitor,
        handshake: Handshake,
    ) -> None:
        self._units, self._channel = units, channel
        self._monitor, self._handshake = monitor, handshake

    @property
    def rate(self) -> float:
        """Greatest rate, controller units per minute."""
        return self._monitor.settings[MAX_RATE + self._units.index]

    @property
    def acceleration(self) -> float:
        """Acceleration of all moves, controller units per second squared."""
        return self._monitor.settings[ACCELERATION + self._units.index]

    def limits(self) -> AxisLimits:
        """
        Return the limits that the settings state.

        :raises ControllerLostError: they have not been read yet
        """
        if ACCELERATION + self._units.index not in self._monitor.settings:
            raise ControllerLostError('the controller is not connected yet')
        one = self._units.length(1.0)
        return AxisLimits(velocity=self.rate / 60 / one, acceleration=self.acceleration / one)

    def set_acceleration(self, acceleration: float) -> None:
        """
        Set the acceleration, rad/s^2, where it differs: the EEPROM endures 100,000 writes.

        :raises ControllerRefusedError: the controller reads back another value
        """
        wanted = round(self._units.length(acceleration), 3)
        if abs(wanted - self.acceleration) <= _TOLERANCE * wanted:
            return
        units = self._units
        command = self._monitor.dialect.set_acceleration(units.letter, units.index, wanted)
        self._channel.send(command)
        self._handshake.read_settings()
        if abs(wanted - self.acceleration) > _TOLERANCE * wanted:
            raise ControllerRefusedError(
                f'{command}: the controller reads back {self.acceleration:.3f}; a byte was lost '
                'on the line, or its firmware limits the acceleration'
            )
