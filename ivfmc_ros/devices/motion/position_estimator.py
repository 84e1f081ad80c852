# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where an axis is between the reports of its board."""

import math

from ivfmc_ros.devices.motion import ramp
from ivfmc_ros.devices.motion.ramp import Motion

# Before any report: the clock of a board without a crystal is good to 0.5 %, and a move begins
# within 20 ms of its acknowledgement. A report is as old as 5 ms more or less.
_SCALE_SIGMA = 0.005
_DELAY_SIGMA = 0.02
_REPORT_SIGMA = 0.005

_BLEND = 0.5  # seconds over which a correction comes in, so that the position never jumps
_STEADY = 0.5  # of the greatest speed: below it a position says little about the time


class Follower:
    """
    The motion model that reports are compared with.

    The planned motion is right in space but not in time: it begins a little late, and the
    board's clock runs a little fast or slow. Both are estimated from the reports, and what was
    learnt of the clock stays for the next move.
    """

    def __init__(self, position: float = 0.0) -> None:
        self._plan: Motion = ramp.rest(position)
        self._speed = 0.0
        self._begun = 0.0
        self._scale = 1.0
        self._scale_sigma = _SCALE_SIGMA
        self._reset_estimate()
        self._jump, self._jump_at = 0.0, -math.inf

    @property
    def scale(self) -> float:
        """Board seconds in a second of this computer, as far as it is known."""
        return self._scale

    @property
    def standing(self) -> bool:
        """No motion is planned."""
        return len(self._plan) == 1

    @property
    def target(self) -> float:
        """Where the motion ends."""
        return self._plan[-1].position

    def rest(self, position: float) -> None:
        """The axis stands."""
        self._plan = ramp.rest(position)
        self._jump_at = -math.inf

    def begin(self, plan: Motion, time: float) -> None:
        """Begin a motion; times in ``plan`` count from 0, which was acknowledged at ``time``."""
        self._plan, self._begun = plan, time
        self._speed = max(abs(piece.velocity) for piece in plan)
        self._scale_sigma = max(min(self._scale_sigma * 2, _SCALE_SIGMA), 1e-4)
        self._reset_estimate()
        self._jump_at = -math.inf

    def brake(self, acceleration: float, time: float) -> None:
        """The axis brakes from now on."""
        position, velocity = self.at(time)
        here = (ramp.Piece(time=0.0, position=position, velocity=velocity),)
        plan = ramp.halt(here, acceleration, 0.0)
        self.rest(position) if velocity == 0.0 else self.begin(plan, time)

    def report(self, time: float, position: float) -> None:
        """The board said at ``time`` that it is at ``position``."""
        passed = ramp.time_of(self._plan, position)
        if passed is None or abs(ramp.at(self._plan, passed)[1]) < _STEADY * self._speed:
            return
        before = self._board_time(time)
        self._learn(time - self._begun, passed)
        self._jump, self._jump_at = before - self._plain_time(time), time

    def at(self, time: float) -> tuple[float, float]:
        """Return (position, velocity)."""
        return ramp.at(self._plan, self._board_time(time))

    def ended(self, time: float) -> bool:
        """Tell whether the motion should have come to its end."""
        return self._board_time(time) >= ramp.end(self._plan)

    def _reset_estimate(self) -> None:
        # board time = scale * (elapsed - delay); the state is (scale, scale * delay)
        self._delay = 0.0
        self._covariance = [[self._scale_sigma**2, 0.0], [0.0, _DELAY_SIGMA**2]]

    def _plain_time(self, time: float) -> float:
        return self._scale * (time - self._begun) - self._delay

    def _board_time(self, time: float) -> float:
        if self.standing:
            return time
        fade = 1 - (time - self._jump_at) / _BLEND
        return self._plain_time(time) + (self._jump * min(fade, 1.0) if fade > 0 else 0.0)

    def _learn(self, elapsed: float, board: float) -> None:
        """Take one pair of times into the least squares estimate of scale and delay."""
        (a, b), (_, c) = self._covariance
        gain_scale, gain_delay = a * elapsed - b, b * elapsed - c
        spread = gain_scale * elapsed - gain_delay + _REPORT_SIGMA**2
        error = board - (self._scale * elapsed - self._delay)
        # a report that was held up on its way says nothing
        if error * error > 25 * spread:
            return
        self._scale += gain_scale / spread * error
        self._delay += gain_delay / spread * error
        a -= gain_scale * gain_scale / spread
        b -= gain_scale * gain_delay / spread
        c -= gain_delay * gain_delay / spread
        self._covariance = [[a, b], [b, c]]
        self._scale_sigma = math.sqrt(max(a, 1e-12))
