# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of a GRBL controller: port, axis, and wiring of the lasers."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
import math

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

# Outputs that a laser can be wired to: G-code that turns it (on, off).
OUTPUTS = {'spindle': ('M3 S{:.0f}', 'M5'), 'coolant': ('M8', 'M9')}


@dataclass(frozen=True, kw_only=True)
class GrblSettings:
    """
    Connection and wiring of a GRBL controller.

    port : device file, or pyserial URL such as socket://host:port
    baud : bits per second
    axis : letter of the axis that turns the table; stock GRBL has X, Y and Z
    units_per_turn : controller units per turn, negative if positive units turn clockwise
    lasers : output of each laser by its name, spindle (M3, M5) or coolant (M8, M9)
    power : 0 to 1, of a laser on the spindle output
    home_timeout : seconds that homing may take

    :raises ParameterError: a value is out of range, or two lasers have one output
    """

    port: str
    baud: int = 115200
    axis: str = 'X'
    units_per_turn: float = 360.0
    lasers: Mapping[str, str] = field(default_factory=dict)
    power: float = 1.0
    home_timeout: float = 120.0

    def __post_init__(self) -> None:
        require_one_of('axis', self.axis, 'XYZABC')
        if not (math.isfinite(self.units_per_turn) and self.units_per_turn):
            raise ParameterError(f'units_per_turn: {self.units_per_turn} must be finite and not 0')
        require_in_range('power', self.power, 0.0, 1.0)
        unknown = [output for output in self.lasers.values() if output not in OUTPUTS]
        if unknown or len(set(self.lasers.values())) != len(self.lasers):
            raise ParameterError(
                f'lasers: {", ".join(self.lasers.values())}: each laser needs its own output, '
                f'{" or ".join(OUTPUTS)}'
            )
