# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trigger line of an emulated motion controller: a pulse each step of travel, and faults."""

from itertools import pairwise
import math

import numpy as np

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.trajectory import Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.model import Floats

# Seconds by which the second pulse of a doubled one is late: longer than the exposure, in which a
# camera ignores pulses.
_DOUBLE_DELAY = (0.006, 0.012)


class TriggerLine:
    """
    Pulses at the multiples of a step of travel. Units are those of the trajectories.

    The line counts the motor's steps: a table that slips on the shaft, and a controller that
    counts from 0 again, make no pulse.

    drop, double : probability of each pulse that it is missing, or followed by a second one
    noise : false pulses per second of motion
    """

    def __init__(self, step: float, seed: int = 0) -> None:
        """
        Start at standstill.

        step : travel between pulses, positive
        """
        self.drop = self.double = self.noise = 0.0
        self._step = step
        self._rng = np.random.default_rng(seed)
        self._motion: Trajectory = trajectory.standstill(0.0)
        # counted travel, and what it differs from the position of the motion
        self._travel = self._offset = 0.0
        self._until = -math.inf
        self._late: list[float] = []

    def move(self, now: float, motion: Trajectory) -> list[float]:
        """Begin another motion; return the times of the pulses until ``now``, seconds."""
        found = self.advance(now)
        self._offset = self._travel - trajectory.state_at(motion, now)[0]
        self._motion = motion
        return found

    def advance(self, until: float) -> list[float]:
        """Return the times of the pulses since the last call, ascending seconds."""
        since, self._until = self._until, max(until, self._until)
        if not math.isfinite(since):
            since = min(self._motion[0].time, self._until)
        found: list[float] = []
        edges = [segment.time for segment in self._motion if since < segment.time < self._until]
        for begin, end in pairwise([since, *edges, self._until]):
            times = self._crossings(begin, end)
            found += self._with_faults(times, begin, end)
        due = sorted([*self._late, *found])
        self._late = [time for time in due if time > self._until]
        return [time for time in due if time <= self._until]

    def _crossings(self, begin: float, end: float) -> Floats:
        """Return when a motion of one segment passes multiples of the step."""
        segment = _segment_at(self._motion, begin)
        # not computed again: a pulse at the border of two segments must come once
        start, stop = self._travel, segment.state_at(end)[0] + self._offset
        self._travel = stop
        if stop >= start:
            first, last = math.floor(start / self._step) + 1, math.floor(stop / self._step)
            numbers = np.arange(first, last + 1)
        else:
            first, last = math.ceil(start / self._step) - 1, math.ceil(stop / self._step)
            numbers = np.arange(first, last - 1, -1)
        distance = numbers * self._step - start
        velocity = segment.state_at(begin)[1]
        sign = 1.0 if stop >= start else -1.0
        root = np.sqrt(np.maximum(velocity**2 + 2.0 * segment.acceleration * distance, 0.0))
        # the root of the quadratic equation that is computed without cancellation
        return np.asarray(begin + 2.0 * distance / (velocity + sign * root))

    def _with_faults(self, times: Floats, begin: float, end: float) -> list[float]:
        kept = times[self._rng.random(len(times)) >= self.drop]
        doubled = kept[self._rng.random(len(kept)) < self.double]
        late = doubled + self._rng.uniform(*_DOUBLE_DELAY, len(doubled))
        count = self._rng.poisson(self.noise * (end - begin)) if len(times) else 0
        false = self._rng.uniform(begin, end, count)
        return [*kept.tolist(), *late.tolist(), *false.tolist()]


def _segment_at(motion: Trajectory, time: float) -> Segment:
    """Return the segment of a motion at a time; before the first one the axis stands."""
    found = Segment(time=time, position=motion[0].position)
    for segment in motion:
        if segment.time > time:
            break
        found = segment
    return found
