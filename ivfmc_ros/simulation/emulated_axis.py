# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Axis of an emulated motion controller: queued moves, acceleration, feed hold, homing."""

from collections import deque
from collections.abc import Callable
from collections.abc import Mapping
import math

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.trajectory import Trajectory

PLANNER_CAPACITY = 15  # moves that wait; size of GRBL's planner buffer less one

_UNITS_PER_TURN = 360.0
# Numbers of ``$`` settings of the X axis, and of homing.
_STEPS, _MAX_RATE, _ACCELERATION, _SEEK, _PULL_OFF = 100, 110, 120, 25, 27


class EmulatedAxis:
    """
    Motion of one axis. Positions are controller units (degrees), times are steady seconds.

    settings : values of the ``$`` settings by number
    on_motion : called with the time and the trajectory of the table when it changes; positions
        are physical, they do not start at 0 again with the controller
    clock_scale : controller seconds per second
    index : of the axis, which counts its settings
    state : GRBL's state, Idle, Run, Hold or Home
    held : whether a feed hold has come to standstill
    """

    def __init__(
        self,
        settings: Mapping[int, float],
        on_motion: Callable[[float, Trajectory], None],
        clock_scale: float,
        *,
        index: int = 0,
    ) -> None:
        self._settings, self._on_motion, self._scale = settings, on_motion, clock_scale
        self._index = index
        self._queue: deque[tuple[float, float]] = deque()
        self._position = 0.0
        self._origin = 0.0  # physical position of the controller's 0
        self._slip = 0.0  # units by which the table has turned on the motor's shaft
        self._motion: Trajectory = trajectory.standstill(0.0)
        self.state = 'Idle'
        self.held = False

    @property
    def moving(self) -> bool:
        """Whether the axis moves."""
        return self.state in ('Run', 'Home') or (self.state == 'Hold' and not self.held)

    @property
    def drained(self) -> bool:
        """Whether all queued moves have ended."""
        return self.state == 'Idle' and not self._queue

    @property
    def planner_full(self) -> bool:
        """Whether the planner buffer has no room for another move."""
        return len(self._queue) > PLANNER_CAPACITY

    @property
    def target(self) -> float:
        """Position at the end of all queued moves."""
        return self._queue[-1][0] if self._queue else self._position

    @property
    def next_event(self) -> float:
        """Time at which the present motion ends, infinite if there is none."""
        return trajectory.end_time(self._motion) if self.moving else math.inf

    def state_at(self, now: float) -> tuple[float, float]:
        """Return (position, velocity); the position is a whole number of steps."""
        position, velocity = self._position, 0.0
        if self.state != 'Idle':
            position, velocity = trajectory.state_at(self._motion, now)
        return self._whole_steps(position), velocity

    def table_at(self, now: float) -> float:
        """Return the physical position of the table, which slips do not hide."""
        return self.state_at(now)[0] + self._origin + self._slip

    def queue_move(self, x: float, relative: bool, feed: float | None) -> None:
        """Queue a move; ``feed`` in units per minute, None for the maximum rate."""
        last = self._queue[-1][0] if self._queue else self._position
        limit = self._settings[_MAX_RATE + self._index]
        rate = limit if feed is None else min(feed, limit)
        target = self._whole_steps(last + x if relative else x)
        self._queue.append((target, max(rate, 1.0) / 60 * self._scale))

    def start(self, now: float) -> bool:
        """Begin the next queued move; each move ends in standstill. Return whether one began."""
        if self.state != 'Idle' or not self._queue:
            return False
        target, speed = self._queue[0]
        self.state = 'Run'
        self._move(trajectory.trapezoid(self._position, target, speed, self._limit, now), now)
        return True

    def advance(self, now: float) -> bool:
        """End a motion that is over, begin the next one; return whether there was one."""
        end = self.next_event
        if now < end:
            return False
        state, self.state = self.state, 'Idle'
        self._position = self._motion[-1].position
        if state == 'Hold':
            self.state, self.held = 'Hold', True
        elif state == 'Home':
            self._origin += self._position + self._settings[_PULL_OFF]
            self._position = -self._settings[_PULL_OFF]
            self._move(trajectory.standstill(self._position, now), now)
        else:
            self._queue.popleft()
            self.start(end)
        return True

    def hold(self, now: float) -> None:
        """Brake (feed hold), and keep the queued moves."""
        if self.state == 'Run':
            self.state, self.held = 'Hold', False
            self._move(trajectory.brake(self._motion, self._limit, now), now)
        elif self.state == 'Idle':
            self.state, self.held = 'Hold', True
            self._motion = trajectory.standstill(self._position, now)

    def resume(self, now: float) -> None:
        """Continue after a feed hold."""
        if self.state == 'Hold' and self.held:
            self.state, self.held = 'Idle', False
            self.start(now)

    def kill(self, now: float) -> bool:
        """Stop at once, discard the queue; return whether the axis moved and lost its position."""
        moved = self.moving
        self._position = self.state_at(now)[0]
        self.state, self.held = 'Idle', False
        self._queue.clear()
        self._move(trajectory.standstill(self._position, now), now)
        return moved

    def home(self, now: float) -> None:
        """Move to the home switch, which is where the physical position is a whole turn."""
        ahead = (
            -(self._position + self._origin + self._settings[_PULL_OFF]) % _UNITS_PER_TURN
            or _UNITS_PER_TURN
        )
        self.state = 'Home'
        target, speed = self._position + ahead, self._settings[_SEEK] / 60 * self._scale
        self._move(trajectory.trapezoid(self._position, target, speed, self._limit, now), now)

    def reset_origin(self) -> None:
        """Make the present position 0, as a power-on does."""
        self._origin += self._position
        self._position = 0.0

    def slip(self, units: float, now: float) -> None:
        """Turn the table on the motor's shaft, which the controller does not notice."""
        self._slip += units
        self._move(self._motion, now)

    @property
    def _limit(self) -> float:
        return self._settings[_ACCELERATION + self._index] * self._scale**2

    def _whole_steps(self, position: float) -> float:
        steps = self._settings[_STEPS + self._index]
        return round(position * steps) / steps

    def _move(self, motion: Trajectory, now: float) -> None:
        self._motion = motion
        self._on_motion(now, trajectory.shift(motion, self._origin + self._slip))
