# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the members of the GRBL family do differently: commands, units, names of settings.

Sources: see ``protocol``. GRBL 0.9 and 1.1, grblHAL and FluidNC share commands and numbers of
settings; FluidNC has settings by path. Horus is derived from GRBL 0.9, with a G-code of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field

# Numbers of GRBL's ``$`` settings; the index of an axis is added to the last two.
REPORT_INCHES, HOMING, MAX_SPINDLE, MAX_RATE, ACCELERATION = 13, 22, 30, 110, 120
AXIS_LETTERS = 'XYZABC'  # in the order in which the family reports them

# G-code that turns an output on and off.
_GRBL_OUTPUTS = {'spindle': ('M3 S{power:.0f}', 'M5'), 'coolant': ('M8', 'M9')}
_HORUS_OUTPUTS = {f'laser{n}': (f'M71T{n}', f'M70T{n}') for n in (1, 2, 3, 4)}


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """
    Commands of one firmware.

    name : as of ``protocol.FIRMWARES``
    move : template of a move with axis, position (controller units) and feed
    feed_seconds : seconds that the feed of a move counts for: 60 for units per minute
    drain : command that is answered when all motion has ended; '' if there is none
    modes : commands that set what a move relies on, after each reset
    outputs : commands (on, off) by the name of an output
    listing : command that lists the settings by number; '' if they are asked by path
    paths : path of a setting by its number, with ``{axis}`` for the letter in lower case
    optional : numbers of settings that a controller may lack
    alarm_after_hold : a reset is an alarm also where the axis stands after a feed hold
    rotary : letters A, B, C are degrees, which have three decimals also with $13=1
    """

    name: str
    move: str = 'G53G1{axis}{position:.4f}F{feed:.3f}'
    feed_seconds: float = 60.0
    drain: str = 'G4P0.01'
    # G1, because in laser mode G0 turns the laser off
    modes: tuple[str, ...] = ('G21G90G94', 'G1F100')
    outputs: Mapping[str, tuple[str, str]] = field(default_factory=lambda: _GRBL_OUTPUTS)
    listing: str = '$$'
    paths: Mapping[int, str] = field(default_factory=dict)
    optional: tuple[int, ...] = (REPORT_INCHES, HOMING, MAX_SPINDLE)
    alarm_after_hold: bool = False

    def queries(self, axis: str, index: int) -> dict[str, bool]:
        """Return the commands that read all settings, and whether each may be refused."""
        if self.listing:
            return {self.listing: False}
        return {
            f'${path.format(axis=axis.lower())}': number in self.optional
            for number, path in self.paths.items()
        }

    def number(self, key: str, axis: str, index: int) -> int | None:
        """Return the number of a setting that a controller names ``key``, None if unknown."""
        if key.isdecimal():
            return int(key)
        for number, path in self.paths.items():
            if key == path.format(axis=axis.lower()):
                return number + (index if number in (MAX_RATE, ACCELERATION) else 0)
        return None

    def set_acceleration(self, axis: str, index: int, value: float) -> str:
        """Return the command that sets the acceleration of the axis, units per second squared."""
        key = self.paths.get(ACCELERATION, f'{ACCELERATION + index}').format(axis=axis.lower())
        return f'${key}={value:.3f}'


_FLUIDNC_PATHS = {
    MAX_RATE: '/axes/{axis}/max_rate_mm_per_min',
    ACCELERATION: '/axes/{axis}/acceleration_mm_per_sec2',
    REPORT_INCHES: '/report_inches',
    MAX_SPINDLE: '30',
    # the cycle of homing in which the axis takes part, 0 or less for none
    HOMING: '/axes/{axis}/homing/cycle',
}
DIALECTS = {
    'Grbl 0.9': Dialect(name='Grbl 0.9', alarm_after_hold=True),
    'Grbl': Dialect(name='Grbl'),
    'grblHAL': Dialect(name='grblHAL'),
    'FluidNC': Dialect(name='FluidNC', listing='', paths=_FLUIDNC_PATHS),
    'Horus': Dialect(
        name='Horus',
        # the only axis that the connector of the table has; feed in degrees per second
        move='G1{axis}{position:.4f}F{feed:.4f}',
        feed_seconds=1.0,
        drain='',
        modes=('M17', 'G1F10'),
        outputs=_HORUS_OUTPUTS,
        alarm_after_hold=True,
    ),
}


def dialect_of(firmware: str, version: str) -> Dialect:
    """
    Return the dialect of a firmware.

    firmware, version : of its banner; '' if it was damaged, or if there was none
    """
    if firmware in ('', 'Grbl'):
        is_old = version.startswith('0.')
        return DIALECTS['Grbl 0.9' if is_old else 'Grbl']
    return DIALECTS.get(firmware, DIALECTS['Grbl'])
