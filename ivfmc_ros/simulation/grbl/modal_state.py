# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Modal state of an emulated GRBL controller (feed, distance, spindle ...) and its outputs."""

from collections.abc import Mapping
from dataclasses import dataclass

from ivfmc_ros.simulation.grbl import gcode
from ivfmc_ros.simulation.grbl.gcode import GcodeBlock
from ivfmc_ros.simulation.grbl.gcode import GcodeError
from ivfmc_ros.simulation.laser_outputs import LaserOutputs

_MAX_SPINDLE, _LASER_MODE = 30, 32  # numbers of ``$`` settings


@dataclass(kw_only=True)
class ModalState:
    """
    Modal G-code state; the defaults are those after a reset.

    feed : units per minute
    speed : of the spindle, as in S
    """

    motion: str = 'G0'
    distance: str = 'G90'
    feed: float = 0.0
    speed: float = 0.0
    spindle: str = 'M5'
    coolant: str = 'M9'

    def apply(self, block: GcodeBlock) -> None:
        """
        Apply a block, except for spindle and coolant, which wait for the end of the motion.

        :raises GcodeError: the block lacks a value
        """
        values, codes = block.values, block.codes
        motion = codes.get('motion', self.motion)
        if codes.get('dwell') == 'G4' and 'P' not in values:
            raise GcodeError(gcode.MISSING)
        if block.moves and motion == 'G1' and not (values.get('F') or self.feed):
            raise GcodeError(gcode.NO_FEED)
        self.motion = motion
        self.distance = codes.get('distance', self.distance)
        self.feed = values.get('F', self.feed)
        self.speed = values.get('S', self.speed)

    def switch_outputs(self, codes: Mapping[str, str]) -> None:
        """Apply the codes of spindle and coolant."""
        self.spindle = codes.get('spindle', self.spindle)
        self.coolant = codes.get('coolant', self.coolant)

    def outputs(self, settings: Mapping[int, float], moving: bool, held: bool) -> LaserOutputs:
        """Return the outputs; in laser mode ($32=1) the spindle depends on the motion."""
        power = min(self.speed / settings[_MAX_SPINDLE], 1.0) if self.spindle != 'M5' else 0.0
        if settings[_LASER_MODE]:
            dark = self.motion == 'G0' or (self.spindle == 'M4' and not moving) or held
            power = 0.0 if dark else power
        return LaserOutputs(spindle=power, coolant=float(self.coolant == 'M8'))

    def letters(self, outputs: LaserOutputs) -> str:
        """Return the letters by which a status report names outputs that are on."""
        spindle = {'M3': 'S', 'M4': 'C', 'M5': ''}[self.spindle] if outputs.spindle else ''
        return spindle + ('F' if outputs.coolant else '')

    def format(self) -> str:
        """Return the response to ``$G``, without ok."""
        return (
            f'[GC:{self.motion} G54 G17 G21 {self.distance} G94 {self.spindle} {self.coolant} '
            f'T0 F{self.feed:.0f} S{self.speed:.0f}]\r\n'
        )
