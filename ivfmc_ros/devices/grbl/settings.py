# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a GRBL board is connected and wired."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
import math

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

# What a laser can be wired to: (on, off).
OUTPUTS = {'spindle': ('M3 S{:.0f}', 'M5'), 'coolant': ('M8', 'M9')}


@dataclass(frozen=True, kw_only=True)
class GrblSettings:
    """
    How the board is connected and wired.

    port : a device file, or a URL of pyserial such as socket://host:port
    axis : letter of the axis that turns the table; stock GRBL has X, Y and Z
    units_per_turn : board units of a turn, negative if the table turns clockwise for positive
    lasers : name of each laser and its output, spindle (M3, M5) or coolant (M8, M9)
    power : 0 to 1 of a laser on the spindle
    home_timeout : seconds
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
            raise ParameterError(f'units_per_turn: {self.units_per_turn} is no number of units')
        require_in_range('power', self.power, 0.0, 1.0)
        wrong = [output for output in self.lasers.values() if output not in OUTPUTS]
        if wrong or len(set(self.lasers.values())) != len(self.lasers):
            raise ParameterError(
                f'lasers: {", ".join(self.lasers.values())}: each needs an output of its own, '
                f'{" or ".join(OUTPUTS)}'
            )
