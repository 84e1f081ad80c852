# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion at piecewise constant acceleration, as a stepper board drives it."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from itertools import pairwise
import math


@dataclass(frozen=True, kw_only=True)
class Piece:
    """
    Constant acceleration from ``time`` until the next piece begins.

    time : seconds
    position, velocity, acceleration : in one unit of angle, per second, per second squared
    """

    time: float
    position: float
    velocity: float = 0.0
    acceleration: float = 0.0

    def at(self, time: float) -> tuple[float, float]:
        """Return (position, velocity) at ``time``."""
        dt = time - self.time
        return (
            self.position + (self.velocity + self.acceleration * dt / 2) * dt,
            self.velocity + self.acceleration * dt,
        )


Motion = tuple[Piece, ...]


def rest(position: float, time: float = 0.0) -> Motion:
    """Return standing still."""
    return (Piece(time=time, position=position),)


def ramp(start: float, target: float, speed: float, acceleration: float, time: float) -> Motion:
    """
    Return a move from standstill to standstill that begins at ``time``.

    speed, acceleration : positive; a short move does not reach the speed
    """
    way = target - start
    if way == 0.0:
        return rest(target, time)
    sign = math.copysign(1.0, way)
    speed = min(speed, math.sqrt(abs(way) * acceleration))
    rise = speed / acceleration
    cruise = max(abs(way) / speed - rise, 0.0)
    a, v = sign * acceleration, sign * speed
    climb = sign * speed * rise / 2
    return (
        Piece(time=time, position=start, acceleration=a),
        Piece(time=time + rise, position=start + climb, velocity=v),
        Piece(time=time + rise + cruise, position=target - climb, velocity=v, acceleration=-a),
        Piece(time=time + 2 * rise + cruise, position=target),
    )


def halt(motion: Motion, acceleration: float, time: float) -> Motion:
    """Return the motion that brakes at ``time`` and then stands."""
    position, velocity = at(motion, time)
    if velocity == 0.0:
        return rest(position, time)
    braking = abs(velocity) / acceleration
    return (
        Piece(
            time=time,
            position=position,
            velocity=velocity,
            acceleration=math.copysign(acceleration, -velocity),
        ),
        Piece(time=time + braking, position=position + velocity * braking / 2),
    )


def at(motion: Sequence[Piece], time: float) -> tuple[float, float]:
    """Return (position, velocity) at ``time``; before the first piece it stood there."""
    piece = motion[0]
    for following in motion[1:]:
        if following.time > time:
            break
        piece = following
    if time < piece.time:
        return piece.position, 0.0
    return piece.at(time)


def end(motion: Sequence[Piece]) -> float:
    """Return when the motion stands, seconds."""
    return motion[-1].time


def time_of(motion: Motion, position: float) -> float | None:
    """Return when a motion of one direction passes ``position``, None outside of its way."""
    for piece, following in pairwise(motion):
        low, high = sorted((piece.position, following.position))
        if low <= position <= high and low < high:
            return piece.time + _passing(piece, position - piece.position)
    return None


def _passing(piece: Piece, way: float) -> float:
    if piece.acceleration == 0.0:
        return way / piece.velocity
    root = math.sqrt(max(piece.velocity**2 + 2 * piece.acceleration * way, 0.0))
    # of the two roots the one that does not cancel
    sign = math.copysign(1.0, way) if way else 1.0
    total = piece.velocity + sign * root
    return 2 * way / total if total else 0.0


def shifted(motion: Motion, way: float) -> Motion:
    """Return the motion with all positions moved by ``way``."""
    return tuple(replace(piece, position=piece.position + way) for piece in motion)
