# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion between the table position in radians and the position units of a controller."""

import math

from ivfmc_ros.errors import ControllerRefusedError

# Setting of the axis by which it is chosen from those of the controller.
AUTO_AXIS = 'auto'
_AXIS_LETTERS = 'XYZABC'  # in the order in which most controllers report them
_ROTARY = 'ABC'


class AxisUnits:
    """
    Units of the axis that turns the table, and the count of turns.

    Unwrapped units grow without limit; a controller may start again at 0, at power-on, after
    homing or with every turn.

    letter : of the axis, one of XYZABC
    index : of the axis in the controller's reports
    units_per_turn : controller units per turn, negative if positive units turn clockwise
    """

    def __init__(self, letter: str, units_per_turn: float) -> None:
        self.letter = letter
        self.index = _AXIS_LETTERS.index(letter)
        self._units_per_turn = abs(units_per_turn)
        self._radians_per_unit = 2 * math.pi / units_per_turn
        self._turn_offset = 0  # turns by which unwrapped units exceed those of the controller

    def choose(self, axis: str, letters: str) -> None:
        """
        Take the axis that is set, after the controller has named those that it has.

        axis : letter, or AUTO_AXIS: the first rotary axis, X if there is none
        letters : of the axes of the controller, in the order of its reports
        :raises ControllerRefusedError: the controller does not have the axis
        """
        if axis == AUTO_AXIS:
            axis = next((letter for letter in letters if letter in _ROTARY), 'X')
        if axis not in letters:
            raise ControllerRefusedError(
                f'the controller has no axis {axis}; it has {", ".join(letters)}'
            )
        self.letter, self.index = axis, letters.index(axis)

    @property
    def turn(self) -> float:
        """Controller units of a turn, positive."""
        return self._units_per_turn

    def to_radians(self, units: float) -> float:
        """Return the table position of unwrapped units."""
        return units * self._radians_per_unit

    def from_radians(self, position: float) -> float:
        """Return the unwrapped units of a table position."""
        return position / self._radians_per_unit

    def to_controller(self, units: float) -> float:
        """Return the controller's own position of unwrapped units."""
        return units - self._turn_offset * self._units_per_turn

    def length(self, radians: float) -> float:
        """Return the magnitude of a distance, velocity or acceleration in units."""
        return abs(radians / self._radians_per_unit)

    def unwrap(self, controller_units: float, expected: float) -> float:
        """
        Return the unwrapped units of the controller's own position, nearest to ``expected``.

        expected : unwrapped units where the axis should be
        """
        turns = round((expected - controller_units) / self._units_per_turn)
        return controller_units + turns * self._units_per_turn

    def set_turns(self, controller_units: float, units: float) -> None:
        """Set the count of turns by one position in both: the controller's and unwrapped."""
        self._turn_offset = round((units - controller_units) / self._units_per_turn)
