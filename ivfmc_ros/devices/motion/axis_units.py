# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Between radians that go on and on, and what a board counts in."""

import math

_LETTERS = 'XYZABC'


class AxisUnits:
    """
    The axis that turns the table, in units of its board that go on and on.

    letter : the axis; units_per_turn : of a turn, negative if positive is clockwise
    """

    def __init__(self, letter: str, units_per_turn: float) -> None:
        self.letter = letter
        self.index = _LETTERS.index(letter)
        self._turn = abs(units_per_turn)
        self._radians = 2 * math.pi / units_per_turn
        self._forgotten = 0  # turns that the board does not count

    def to_radians(self, units: float) -> float:
        """Return the table position of unwrapped units."""
        return units * self._radians

    def from_radians(self, position: float) -> float:
        """Return the unwrapped units of a table position."""
        return position / self._radians

    def to_board(self, units: float) -> float:
        """Return what the board calls the position ``units``."""
        return units - self._forgotten * self._turn

    def length(self, radians: float) -> float:
        """Return an unsigned distance, velocity or acceleration in units."""
        return abs(radians / self._radians)

    def unwrap(self, board: float, expected: float) -> float:
        """
        Return the unwrapped position that the board calls ``board``.

        Whole turns are counted that the board forgets when it is started or homed, or when it
        begins every turn at 0.

        expected : units, where the axis should be, within half a turn
        """
        turns = round((expected - board) / self._turn - self._forgotten)
        self._forgotten += turns
        return board + self._forgotten * self._turn
