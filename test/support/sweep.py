# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A continuous sweep as a camera and a board report it: late, and never by the same delay."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from support.synthetic import draw_stripe
from support.synthetic import expose

SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A table that stands at 0, turns and stands again; radians and seconds."""

    speed: float = 0.42
    acceleration: float = 2.0
    begin: float = 1.0
    cruise: float = 16.0

    def at(self, seconds: Any) -> Any:
        """Where the table truly is."""
        rise = self.speed / self.acceleration
        t = np.clip(np.asarray(seconds, dtype=float) - self.begin, 0.0, None)
        up = np.minimum(t, rise)
        steady = np.clip(t - rise, 0.0, self.cruise)
        down = np.clip(t - rise - self.cruise, 0.0, rise)
        a = self.acceleration
        return a * up**2 / 2 + self.speed * (steady + down) - a * down**2 / 2

    @property
    def steady(self) -> tuple[float, float]:
        """When it turns at constant speed."""
        rise = self.speed / self.acceleration
        return self.begin + rise, self.begin + rise + self.cruise


def reports(turn: Turn, rate: float, until: float, seed: int = 0) -> list[tuple[int, float]]:
    """Stamps and positions of a board that answers 5 to 20 ms late."""
    rng = np.random.default_rng(seed)
    asked = np.arange(-1.0, until, 1.0 / rate)
    late = asked + rng.uniform(0.005, 0.020, len(asked))
    stamps = START + (late * SECOND).astype(np.int64)
    return [(int(s), float(p)) for s, p in zip(stamps, turn.at(asked), strict=True)]


def recorded(cell, sphere, turn: Turn, rate: float, until: float) -> list[tuple[int, str, Any]]:
    """All that is heard of a sweep of the first laser, by stamp: (stamp, kind, what)."""
    events: list[tuple[int, str, Any]] = []
    events += [(stamp, 'table', position) for stamp, position in reports(turn, 10.0, until + 0.5)]
    for tick in np.arange(-0.5, until + 0.5, 0.1):
        events.append((START + round(tick * SECOND), 'lit', tick >= 0.3))
    rng = np.random.default_rng(1)
    for shot in np.arange(0.0, until, 1.0 / rate):
        light = draw_stripe(sphere.stripe(cell, float(turn.at(shot))))
        events.append((START + round(shot * SECOND), 'picture', expose(light, rng)))
    return sorted(events, key=lambda event: event[0])
