# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an emulated GRBL board remembers from line to line, and what its outputs do."""

from collections.abc import Mapping
from dataclasses import dataclass

from ivfmc_ros.simulation.grbl import gcode
from ivfmc_ros.simulation.grbl.gcode import Block
from ivfmc_ros.simulation.grbl.gcode import LineError

_FULL_POWER, _LASER_MODE = 30, 32


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """
    What the two outputs do.

    spindle : 0 to 1 of full power; coolant : 0 or 1
    """

    spindle: float = 0.0
    coolant: float = 0.0


@dataclass(kw_only=True)
class Modes:
    """Modes after a reset; ``feed`` in units per minute, ``speed`` as in S."""

    motion: str = 'G0'
    distance: str = 'G90'
    feed: float = 0.0
    speed: float = 0.0
    spindle: str = 'M5'
    coolant: str = 'M9'

    def take(self, block: Block) -> None:
        """
        Remember what a line says, all but spindle and coolant, which wait for the motion.

        :raises LineError: the line cannot be done
        """
        values, codes = block.values, block.codes
        motion = codes.get('motion', self.motion)
        if codes.get('dwell') == 'G4' and 'P' not in values:
            raise LineError(gcode.MISSING)
        if block.moves and motion == 'G1' and not (values.get('F') or self.feed):
            raise LineError(gcode.NO_FEED)
        self.motion = motion
        self.distance = codes.get('distance', self.distance)
        self.feed = values.get('F', self.feed)
        self.speed = values.get('S', self.speed)

    def switch(self, codes: Mapping[str, str]) -> None:
        """Switch spindle and coolant."""
        self.spindle = codes.get('spindle', self.spindle)
        self.coolant = codes.get('coolant', self.coolant)

    def outputs(self, settings: Mapping[int, float], moving: bool, held: bool) -> Outputs:
        """Return what comes out; in laser mode that depends on the motion."""
        power = min(self.speed / settings[_FULL_POWER], 1.0) if self.spindle != 'M5' else 0.0
        if settings[_LASER_MODE]:
            dark = self.motion == 'G0' or (self.spindle == 'M4' and not moving) or held
            power = 0.0 if dark else power
        return Outputs(spindle=power, coolant=float(self.coolant == 'M8'))

    def letters(self, outputs: Outputs) -> str:
        """Return how a status report names the outputs that are on."""
        spindle = {'M3': 'S', 'M4': 'C', 'M5': ''}[self.spindle] if outputs.spindle else ''
        return spindle + ('F' if outputs.coolant else '')

    def text(self) -> str:
        """Return the answer to ``$G``, without its ok."""
        return (
            f'[GC:{self.motion} G54 G17 G21 {self.distance} G94 {self.spindle} {self.coolant} '
            f'T0 F{self.feed:.0f} S{self.speed:.0f}]\r\n'
        )
