# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories of one axis with piecewise constant acceleration (trapezoidal velocity)."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from itertools import pairwise
import math


@dataclass(frozen=True, kw_only=True)
class Segment:
    """
    Constant acceleration from ``time`` until the next segment begins.

    time : seconds
    position, velocity, acceleration : in one unit of angle, per second, per second squared
    """

    time: float
    position: float
    velocity: float = 0.0
    acceleration: float = 0.0

    def state_at(self, time: float) -> tuple[float, float]:
        """Return (position, velocity) at ``time``."""
        dt = time - self.time
        return (
            self.position + (self.velocity + self.acceleration * dt / 2) * dt,
            self.velocity + self.acceleration * dt,
        )


Trajectory = tuple[Segment, ...]


def standstill(position: float, time: float = 0.0) -> Trajectory:
    """Return the trajectory of an axis that stands at ``position``."""
    return (Segment(time=time, position=position),)


def trapezoid(
    start: float, target: float, speed: float, acceleration: float, time: float
) -> Trajectory:
    """
    Return a move from standstill to standstill that begins at ``time``.

    speed, acceleration : positive; a short move does not reach the speed
    """
    distance = target - start
    if distance == 0.0:
        return standstill(target, time)
    sign = math.copysign(1.0, distance)
    speed = min(speed, math.sqrt(abs(distance) * acceleration))
    ramp_time = speed / acceleration
    cruise_time = max(abs(distance) / speed - ramp_time, 0.0)
    a, v = sign * acceleration, sign * speed
    ramp_distance = sign * speed * ramp_time / 2
    return (
        Segment(time=time, position=start, acceleration=a),
        Segment(time=time + ramp_time, position=start + ramp_distance, velocity=v),
        Segment(
            time=time + ramp_time + cruise_time,
            position=target - ramp_distance,
            velocity=v,
            acceleration=-a,
        ),
        Segment(time=time + 2 * ramp_time + cruise_time, position=target),
    )


def brake(trajectory: Sequence[Segment], acceleration: float, time: float) -> Trajectory:
    """Return the trajectory that brakes at ``time`` from its present velocity to standstill."""
    position, velocity = state_at(trajectory, time)
    if velocity == 0.0:
        return standstill(position, time)
    braking_time = abs(velocity) / acceleration
    return (
        Segment(
            time=time,
            position=position,
            velocity=velocity,
            acceleration=math.copysign(acceleration, -velocity),
        ),
        Segment(time=time + braking_time, position=position + velocity * braking_time / 2),
    )


def state_at(trajectory: Sequence[Segment], time: float) -> tuple[float, float]:
    """Return (position, velocity) at ``time``; before the first segment the axis stands."""
    segment = trajectory[0]
    for following in trajectory[1:]:
        if following.time > time:
            break
        segment = following
    if time < segment.time:
        return segment.position, 0.0
    return segment.state_at(time)


def end_time(trajectory: Sequence[Segment]) -> float:
    """Return when the axis stands again, seconds."""
    return trajectory[-1].time


def time_at_position(trajectory: Trajectory, position: float) -> float | None:
    """Return when a move in one direction passes ``position``, None if it does not."""
    for segment, following in pairwise(trajectory):
        low, high = sorted((segment.position, following.position))
        if low <= position <= high and low < high:
            return segment.time + _time_to_travel(segment, position - segment.position)
    return None


def _time_to_travel(segment: Segment, distance: float) -> float:
    """Return seconds from the begin of a segment until it has covered ``distance``."""
    if segment.acceleration == 0.0:
        return distance / segment.velocity
    root = math.sqrt(max(segment.velocity**2 + 2 * segment.acceleration * distance, 0.0))
    # the root of the quadratic equation that is computed without cancellation
    sign = math.copysign(1.0, distance) if distance else 1.0
    velocity_sum = segment.velocity + sign * root
    return 2 * distance / velocity_sum if velocity_sum else 0.0


def shift(trajectory: Trajectory, offset: float) -> Trajectory:
    """Return the trajectory with ``offset`` added to all positions."""
    return tuple(replace(segment, position=segment.position + offset) for segment in trajectory)


def cruise_speed(distance: float, seconds: float, acceleration: float) -> float:
    """
    Return the speed at which a trapezoidal move of ``distance`` takes ``seconds``.

    Solves v^2 - a t v + a d = 0 for the smaller v, in the form without cancellation.

    distance, acceleration : radians and rad/s^2, not negative
    :returns: rad/s, infinite if no speed is high enough
    """
    discriminant = (acceleration * seconds) ** 2 - 4 * acceleration * distance
    if discriminant < 0.0:
        return math.inf
    return 2 * distance / (seconds + math.sqrt(discriminant) / acceleration)
