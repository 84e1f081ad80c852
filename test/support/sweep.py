# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Events of one continuous sweep: images, and states that arrive with a varying delay."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from support.synthetic import draw_stripe
from support.synthetic import expose

SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND


@dataclass(frozen=True, kw_only=True)
class TrapezoidalMotion:
    """
    A table that stands still at 0, turns with a trapezoidal velocity, and stands still again.

    speed, acceleration : rad/s and rad/s^2
    begin, cruise : start of the motion, and duration of constant speed, seconds
    """

    speed: float = 0.42
    acceleration: float = 2.0
    begin: float = 1.0
    cruise: float = 16.0

    def position_at(self, seconds: Any) -> Any:
        """Return the true position of the table, radians."""
        ramp = self.speed / self.acceleration
        t = np.clip(np.asarray(seconds, dtype=float) - self.begin, 0.0, None)
        up = np.minimum(t, ramp)
        steady = np.clip(t - ramp, 0.0, self.cruise)
        down = np.clip(t - ramp - self.cruise, 0.0, ramp)
        a = self.acceleration
        return a * up**2 / 2 + self.speed * (steady + down) - a * down**2 / 2

    @property
    def constant_speed(self) -> tuple[float, float]:
        """Begin and end of the motion at constant speed, seconds."""
        ramp = self.speed / self.acceleration
        return self.begin + ramp, self.begin + ramp + self.cruise


def delayed_positions(
    motion: TrapezoidalMotion, rate: float, until: float, seed: int = 0
) -> list[tuple[int, float]]:
    """Return stamps and positions of a controller whose stamps are 5 to 20 ms late."""
    rng = np.random.default_rng(seed)
    measured = np.arange(-1.0, until, 1.0 / rate)
    received = measured + rng.uniform(0.005, 0.020, len(measured))
    stamps = START + (received * SECOND).astype(np.int64)
    positions = motion.position_at(measured)
    return [(int(s), float(p)) for s, p in zip(stamps, positions, strict=True)]


def sweep_events(
    cell, sphere, motion: TrapezoidalMotion, rate: float, until: float
) -> list[tuple[int, str, Any]]:
    """Return (stamp, kind, value) of a sweep of one laser; kind is table, laser or image."""
    positions = delayed_positions(motion, 10.0, until + 0.5)
    ticks = np.arange(-0.5, until + 0.5, 0.1)
    events: list[tuple[int, str, Any]] = [(stamp, 'table', angle) for stamp, angle in positions]
    events += [(START + round(tick * SECOND), 'laser', tick >= 0.3) for tick in ticks]
    rng = np.random.default_rng(1)
    for second in np.arange(0.0, until, 1.0 / rate):
        light = draw_stripe(sphere.stripe(cell, float(motion.position_at(second))))
        events.append((START + round(second * SECOND), 'image', expose(light, rng)))
    return sorted(events, key=lambda event: event[0])
