# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The axis of an emulated GRBL board: queued moves, acceleration, hold, homing."""

from collections import deque
from collections.abc import Callable
from collections.abc import Mapping
import math

from ivfmc_ros.devices.motion import ramp
from ivfmc_ros.devices.motion.ramp import Motion

PLANNER_ROOM = 15  # motions that wait

_TURN = 360.0
_STEPS, _MAX_RATE, _ACCELERATION, _SEEK, _PULL_OFF = 100, 110, 120, 25, 27


class GrblAxis:
    """
    Positions are board units (degrees), times are seconds of any steady clock.

    settings : the board's, by number
    on_motion : called with each new motion of the shaft; its positions are physical, that is
        they go on when the board begins at 0 again
    clock_scale : board seconds in a second
    """

    def __init__(
        self,
        settings: Mapping[int, float],
        on_motion: Callable[[float, Motion], None],
        clock_scale: float,
    ) -> None:
        self._settings, self._on_motion, self._scale = settings, on_motion, clock_scale
        self._blocks: deque[tuple[float, float]] = deque()
        self._position = 0.0
        self._origin = 0.0  # physical position of the board's 0
        self._slipped = 0.0  # by which the table is not where the motor is
        self._motion: Motion = ramp.rest(0.0)
        self.state = 'Idle'
        self.held = False

    @property
    def moving(self) -> bool:
        """The shaft turns."""
        return self.state in ('Run', 'Home') or (self.state == 'Hold' and not self.held)

    @property
    def drained(self) -> bool:
        """All that was queued is done."""
        return self.state == 'Idle' and not self._blocks

    @property
    def crowded(self) -> bool:
        """There is no room for another motion."""
        return len(self._blocks) > PLANNER_ROOM

    @property
    def due(self) -> float:
        """When the present motion ends, infinite if there is none."""
        return ramp.end(self._motion) if self.moving else math.inf

    def at(self, now: float) -> tuple[float, float]:
        """Return position, a whole number of steps, and velocity."""
        position, velocity = self._position, 0.0
        if self.state != 'Idle':
            position, velocity = ramp.at(self._motion, now)
        return self._whole_steps(position), velocity

    def queue(self, x: float, relative: bool, feed: float | None) -> None:
        """Queue a move; ``feed`` is units per minute, None for as fast as can be."""
        last = self._blocks[-1][0] if self._blocks else self._position
        limit = self._settings[_MAX_RATE]
        rate = limit if feed is None else min(feed, limit)
        target = self._whole_steps(last + x if relative else x)
        self._blocks.append((target, max(rate, 1.0) / 60 * self._scale))

    def start(self, now: float) -> bool:
        """Begin the next motion. A corner is taken at standstill, also a straight one."""
        if self.state != 'Idle' or not self._blocks:
            return False
        target, speed = self._blocks[0]
        self.state = 'Run'
        self._move(ramp.ramp(self._position, target, speed, self._limit, now), now)
        return True

    def advance(self, now: float) -> bool:
        """Tell whether a motion has ended; the next one begins."""
        end = self.due
        if now < end:
            return False
        state, self.state = self.state, 'Idle'
        self._position = self._motion[-1].position
        if state == 'Hold':
            self.state, self.held = 'Hold', True
        elif state == 'Home':
            self._origin += self._position + self._settings[_PULL_OFF]
            self._position = -self._settings[_PULL_OFF]
            self._move(ramp.rest(self._position, now), now)
        else:
            self._blocks.popleft()
            self.start(end)
        return True

    def hold(self, now: float) -> None:
        """Brake, and keep what is queued."""
        if self.state == 'Run':
            self.state, self.held = 'Hold', False
            self._move(ramp.halt(self._motion, self._limit, now), now)
        elif self.state == 'Idle':
            self.state, self.held = 'Hold', True
            self._motion = ramp.rest(self._position, now)

    def resume(self, now: float) -> None:
        """Go on after a hold."""
        if self.state == 'Hold' and self.held:
            self.state, self.held = 'Idle', False
            self.start(now)

    def kill(self, now: float) -> bool:
        """Stop where it is, forget what is queued; tell whether it moved, and lost its place."""
        moved = self.moving
        self._position = self.at(now)[0]
        self.state, self.held = 'Idle', False
        self._blocks.clear()
        self._move(ramp.rest(self._position, now), now)
        return moved

    def home(self, now: float) -> None:
        """Go on to the switch, which is where the physical position is a whole turn."""
        ahead = -(self._position + self._origin + self._settings[_PULL_OFF]) % _TURN or _TURN
        self.state = 'Home'
        target, speed = self._position + ahead, self._settings[_SEEK] / 60 * self._scale
        self._move(ramp.ramp(self._position, target, speed, self._limit, now), now)

    def zero(self) -> None:
        """Call the present position 0, as a board does that has lost its power."""
        self._origin += self._position
        self._position = 0.0

    def slip(self, units: float, now: float) -> None:
        """Let the table turn on its shaft, which the board does not notice."""
        self._slipped += units
        self._move(self._motion, now)

    @property
    def _limit(self) -> float:
        return self._settings[_ACCELERATION] * self._scale**2

    def _whole_steps(self, position: float) -> float:
        return round(position * self._settings[_STEPS]) / self._settings[_STEPS]

    def _move(self, motion: Motion, now: float) -> None:
        self._motion = motion
        self._on_motion(now, ramp.shifted(motion, self._origin + self._slipped))
