# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Lost steps, by an index mark: a switch that the table passes once a turn, on a controller's pin.

A report has the position of the motor and the state of the pin. The pin changed between two
reports, so one pass tells the mark to the distance that the table moved in between: speed divided
by the rate of reports. All passes together tell it better, as their ranges overlap. A range that
does not overlap is a slip.
"""

# A range is widened by this share of it and by these units at both ends: GRBL reads the pin up to
# some 2 ms after the position (reports are 125 ms apart), and a switch repeats to some 0.02.
_MARGIN, _LEAST_MARGIN = 0.05, 0.05
# Reports of the new state after which the pin has changed: one alone may be a damaged line.
_CONFIRMED = 2


class IndexMark:
    """
    Compares where the pin changes with where it did in former turns.

    passes : times that the mark was passed
    slip : (least, greatest) units by which the mark was late (positive) or early when it first
        contradicted the former turns, None while it agrees
    slipped_at : position at that pass, units, 0 before
    """

    def __init__(self, turn: float) -> None:
        """``turn`` : controller units of a turn, positive."""
        self._turn = turn
        self.reset()

    def reset(self) -> None:
        """Forget the mark: the position has another reference from now on."""
        self._last: tuple[float, bool] | None = None
        self._changing: list[float] = []
        # range of the position of the mark within a turn, by direction of motion and new state
        self._known: dict[tuple[bool, bool], tuple[float, float]] = {}
        self.passes = 0
        self.slip: tuple[float, float] | None = None
        self.slipped_at = 0.0

    @property
    def text(self) -> str:
        """What the mark told, for a person; in degrees."""
        scale = 360.0 / self._turn
        if self.slip is not None:
            low, high = sorted(abs(scale * value) for value in self.slip)
            way = 'late' if self.slip[0] > 0.0 else 'early'
            return (
                f'index mark {low:.1f} to {high:.1f} degrees {way} at '
                f'{scale * self.slipped_at:.1f} degrees: the table slipped'
            )
        if not self._known:
            return 'not passed yet'
        width = max(high - low for low, high in self._known.values())
        return f'passed {self.passes} times, known within {scale * width:.2f} degrees'

    def update(self, position: float, is_active: bool) -> None:
        """
        Evaluate a report.

        position : of the motor, unwrapped units
        is_active : whether the switch is
        """
        if self._last is None:
            self._last = position, is_active
            return
        before, was_active = self._last
        if is_active == was_active:
            self._last, self._changing = (position, is_active), []
            return
        self._changing.append(position)
        if len(self._changing) < _CONFIRMED:
            return
        first = self._changing[0]
        self._last, self._changing = (position, is_active), []
        if 0.0 < abs(first - before) < 0.5 * self._turn:
            self._pass(before, first, is_active)

    def _pass(self, before: float, after: float, is_active: bool) -> None:
        """Compare one pass: the pin changed between two positions."""
        self.passes += 1
        margin = _LEAST_MARGIN + _MARGIN * abs(after - before)
        low, high = min(before, after) - margin, max(before, after) + margin
        key = after > before, is_active
        known = self._known.get(key)
        if known is None:
            self._known[key] = low, high
            return
        turns = round((low + high - known[0] - known[1]) / (2.0 * self._turn))
        low, high = low - turns * self._turn, high - turns * self._turn
        if low <= known[1] and known[0] <= high:
            self._known[key] = max(low, known[0]), min(high, known[1])
        elif self.slip is None:
            self.slip, self.slipped_at = (low - known[1], high - known[0]), after
