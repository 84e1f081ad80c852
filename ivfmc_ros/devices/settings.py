# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of a motion controller: firmware, port, axis, and wiring of the lasers."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
import math

from ivfmc_ros.devices.motion.axis_units import AUTO_AXIS
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

# Values of ``firmware``; auto finds out by what the controller says.
FIRMWARES = ('auto', 'grbl', 'grblhal', 'fluidnc', 'horus', 'marlin', 'fabscan')
# Names of outputs that a laser can be wired to, of all firmwares: GRBL has spindle and coolant,
# Marlin spindle and fan0 to fan3, Horus laser1 to laser4, FabScan laser1 and laser2.
OUTPUTS = (
    *('spindle', 'coolant'),
    *(f'fan{number}' for number in range(4)),
    *(f'laser{number}' for number in range(1, 5)),
)

# Letters of inputs in the reports of GRBL 1.1: limit switches, and P, the probe.
INDEX_PINS = ('X', 'Y', 'Z', 'P')


@dataclass(frozen=True, kw_only=True)
class ControllerSettings:
    """
    Connection and wiring of a motion controller.

    port : device file, or pyserial URL such as socket://host:port
    baud : bits per second
    firmware : one of FIRMWARES
    axis : letter of the axis that turns the table; auto for the first rotary axis (A, B, C) that
        the controller has, X without one
    units_per_turn : controller units per turn (steps for FabScan), negative if positive units turn
        clockwise
    lasers : output of each laser by its name, see OUTPUTS
    power : 0 to 1, of a laser on an output that can be dimmed
    home_timeout : seconds that homing may take
    index_pin : letter of the input, see INDEX_PINS, that a switch on the table makes active once a
        turn; '' without one

    :raises ParameterError: a value is out of range, or two lasers have one output
    """

    port: str
    baud: int = 115200
    firmware: str = 'auto'
    axis: str = AUTO_AXIS
    units_per_turn: float = 360.0
    lasers: Mapping[str, str] = field(default_factory=dict)
    power: float = 1.0
    home_timeout: float = 120.0
    index_pin: str = ''

    def __post_init__(self) -> None:
        require_one_of('controller', self.firmware, FIRMWARES)
        require_one_of('axis', self.axis, (AUTO_AXIS, *'XYZABC'))
        if not (math.isfinite(self.units_per_turn) and self.units_per_turn):
            raise ParameterError(f'units_per_turn: {self.units_per_turn} must be finite and not 0')
        require_in_range('power', self.power, 0.0, 1.0)
        require_one_of('index_pin', self.index_pin, ('', *INDEX_PINS))
        unknown = [output for output in self.lasers.values() if output not in OUTPUTS]
        if unknown or len(set(self.lasers.values())) != len(self.lasers):
            raise ParameterError(
                f'lasers: {", ".join(self.lasers.values())}: each laser needs its own output, '
                f'one of {", ".join(OUTPUTS)}'
            )
