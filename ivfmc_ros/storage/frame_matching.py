# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which table angle and which laser belong to a picture.

The same rules decide for a bag that is read and for messages as they arrive, so that a scan that
is replayed or reconstructed consists of the profiles that it had live. A picture waits until the
table and the lasers have been reported past its exposure; one that has waited too long is judged
by what is known.
"""

from bisect import insort
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.reports import DARK
from ivfmc_ros.storage.reports import LaserReports
from ivfmc_ros.storage.reports import TableReports

_NANOSECONDS = 1_000_000_000
_TURN = 2.0 * math.pi

MOTIONS = ('continuous', 'step')

# Reports that are so far behind a picture do not come late: they are by another clock.
_FAR_NS = 10 * _NANOSECONDS

# Reports are kept so long, for pictures that come late.
HISTORY_S = 30.0


@dataclass(frozen=True, kw_only=True)
class MatchSettings:
    """
    What makes a picture a profile.

    motion : continuous (every picture with one laser on), or step (only what was exposed while
        the table stood, and once for each view and angle)
    exposure : seconds; a picture during which a laser changed is not used
    always_on : the only laser of the cell was always on, and nobody reports it
    views : the view number of each laser in the order of the cell, -1 where it is not measured
        now; empty: its own index
    settle : seconds that the table must have stood before the exposure (step)
    stand : radians that a table that stands may seem to move (step)
    min_step : radians; less than this from the profile before is the same angle (step)
    dark : give each picture the last one that was exposed with all lasers off at the same stand
        of the table (step)
    """

    motion: str = 'continuous'
    exposure: float = 0.02
    always_on: bool = False
    views: tuple[int, ...] = ()
    settle: float = 0.1
    stand: float = 2e-4
    min_step: float = 1e-3
    dark: bool = False

    def __post_init__(self) -> None:
        if self.motion not in MOTIONS:
            raise ParameterError(f'motion: {self.motion!r} is not one of {", ".join(MOTIONS)}')
        for name, value, high in (
            ('exposure', self.exposure, 10.0),
            ('settle', self.settle, 60.0),
            ('stand', self.stand, 0.1),
            ('min_step', self.min_step, math.pi),
        ):
            if not 0.0 <= value <= high:
                raise ParameterError(f'{name}: {value} is out of range; it must be 0 to {high:g}')
        if any(not -1 <= view <= 65535 for view in self.views):
            raise ParameterError(f'view: {list(self.views)}: each must be -1 to 65535')

    def view_of(self, laser: int) -> int:
        """Return the view number of a laser, -1 where it is not measured."""
        if not self.views:
            return laser
        return self.views[laser] if laser < len(self.views) else -1


@dataclass(frozen=True, eq=False, kw_only=True)
class Match:
    """
    What was found out about a picture.

    payload : the picture, as it was handed over
    reason : why it is not used; empty if it is
    angle : radians, a float32 that is sent without rounding, less the whole turns with which the
        scan began
    speed : of the table, radians per second, as reported
    dark : the picture with all lasers off at the same place, if that is asked for and there is one
    """

    payload: Any
    stamp_ns: int
    reason: str = ''
    angle: float = math.nan
    speed: float = 0.0
    laser: int = 0
    view: int = 0
    dark: 'Dark | None' = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Dark:
    """A picture that was exposed with all lasers off, the table standing at ``angle``, radians."""

    payload: Any
    stamp_ns: int
    angle: float


@dataclass(order=True)
class _Waiting:
    stamp_ns: int
    number: int
    arrived_s: float
    payload: Any
    settings: MatchSettings


class Matcher:
    """Finds angle and laser of pictures; whatever comes may come late, early or not at all."""

    def __init__(
        self,
        lasers: Sequence[str],
        settings: MatchSettings | None = None,
        history_s: float = HISTORY_S,
    ) -> None:
        """``history_s``: so many seconds of reports are kept, for pictures that come late."""
        self.settings = settings or MatchSettings()
        self._history_s = history_s
        self._lasers = tuple(lasers)
        self._table = TableReports()
        self._lit = LaserReports(self._lasers)
        self._waiting: list[_Waiting] = []
        self._count = 0
        self._table_heard_s = -math.inf
        self._lasers_heard_s = -math.inf
        self.restart()

    def __len__(self) -> int:
        """How many pictures wait."""
        return len(self._waiting)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the lasers."""
        return self._lasers

    def ahead_s(self, stamp_ns: int) -> float:
        """Return by how much a stamp is ahead of the table's newest, seconds; 0 without one."""
        stamps = self._table.stamps
        return (stamp_ns - stamps[-1]) / _NANOSECONDS if stamps else 0.0

    @property
    def table_known(self) -> bool:
        """Whether the table has been reported."""
        return bool(self._table.stamps)

    @property
    def lasers_known(self) -> bool:
        """Whether lasers have been reported, or need not be."""
        return self.settings.always_on or bool(self._lit.stamps)

    def restart(self) -> None:
        """Begin a scan: forget what was measured, not what is known of table and lasers."""
        self._turns: float | None = None
        self._measured: dict[int, float] = {}
        self._dark: Dark | None = None

    def table(
        self, stamp_ns: int, position: float, velocity: float | None = None, now_s: float = 0.0
    ) -> bool:
        """Take a report, radians and radians per second; False where the time jumped back."""
        self._table_heard_s = now_s
        self._table.forget(self._history_s)
        return self._table.add(stamp_ns, position, velocity)

    def lasers(self, stamp_ns: int, states: Mapping[str, float], now_s: float = 0.0) -> bool:
        """Take a report, above 0.5 is on; False where the time jumped back."""
        self._lasers_heard_s = now_s
        self._lit.forget(self._history_s)
        return self._lit.add(stamp_ns, states)

    def picture(self, stamp_ns: int, payload: Any, now_s: float = 0.0) -> None:
        """
        Let a picture wait; it will be judged by the settings of now.

        now_s : when it came, on a clock that never jumps
        """
        self._count += 1
        insort(self._waiting, _Waiting(stamp_ns, self._count, now_s, payload, self.settings))

    def drop_oldest(self) -> Match:
        """Give up the picture that comes first."""
        first = self._waiting.pop(0)
        return Match(payload=first.payload, stamp_ns=first.stamp_ns, reason='waited too long')

    def ready(self, now_s: float = math.inf, patience_s: float = 0.0) -> Iterator[Match]:
        """
        Yield pictures, by stamp, as far as they can be judged.

        now_s, patience_s : when what a picture waits for has not come for so long, the picture
            is judged by what is known
        """
        while self._waiting:
            first = self._waiting[0]
            if now_s - self._waits_since(first) < patience_s:
                return
            del self._waiting[0]
            yield self._judge(first)

    def _waits_since(self, waiting: _Waiting) -> float:
        """Return when something was last heard that the picture waits for; -inf: it need not."""
        stamp_ns, settings = waiting.stamp_ns, waiting.settings
        end = stamp_ns + int(settings.exposure * _NANOSECONDS)
        needed = end if settings.motion == 'step' else stamp_ns
        table, lasers = self._table.stamps, self._lit.stamps
        since = -math.inf
        if not table or not table[0] <= stamp_ns or table[-1] < needed:
            since = _since(waiting, table, self._table_heard_s)
        if not settings.always_on and (not lasers or lasers[-1] < end):
            since = max(since, _since(waiting, lasers, self._lasers_heard_s))
        return since

    def _judge(self, waiting: _Waiting) -> Match:
        stamp, settings = waiting.stamp_ns, waiting.settings
        exposure = int(settings.exposure * _NANOSECONDS)
        laser, reason = self._lit.during(stamp, exposure, settings.always_on)
        if not self._table.covers(stamp):
            reason = 'no angle'
        elif laser is not None and settings.view_of(laser) < 0:
            reason = 'laser not measured'
        elif not reason and settings.motion == 'step':
            reason = self._why_no_step(waiting, settings.view_of(laser or 0))
        if reason == DARK and settings.dark and self._stands(waiting):
            self._dark = Dark(payload=waiting.payload, stamp_ns=stamp, angle=self._table.at(stamp))
        if reason or laser is None:
            return Match(payload=waiting.payload, stamp_ns=stamp, reason=reason)
        angle = self._table.at(stamp)
        if self._turns is None:
            # many turns from zero, single precision would not hold an angle
            self._turns = _TURN * round(angle / _TURN)
        self._measured[settings.view_of(laser)] = angle
        return Match(
            payload=waiting.payload,
            stamp_ns=stamp,
            angle=float(np.float32(angle - self._turns)),
            speed=float(np.float32(self._table.speed(stamp))),
            laser=laser,
            view=settings.view_of(laser),
            dark=self._dark_at(angle) if settings.dark else None,
        )

    def _stands(self, waiting: _Waiting) -> bool:
        stamp_ns, settings = waiting.stamp_ns, waiting.settings
        begin = stamp_ns - int(settings.settle * _NANOSECONDS)
        end = stamp_ns + int(settings.exposure * _NANOSECONDS)
        return self._table.way(begin, end) <= settings.stand

    def _dark_at(self, angle: float) -> Dark | None:
        dark = self._dark
        return dark if dark and abs(dark.angle - angle) < self.settings.min_step else None

    def _why_no_step(self, waiting: _Waiting, view: int) -> str:
        stamp_ns, settings = waiting.stamp_ns, waiting.settings
        if not self._stands(waiting):
            return 'table moving'
        before = self._measured.get(view, math.inf)
        same = abs(self._table.at(stamp_ns) - before) < settings.min_step
        return 'angle measured already' if same else ''


def _since(waiting: _Waiting, stamps: Sequence[int], heard_s: float) -> float:
    """Return when a picture was last given reason to wait for reports, seconds."""
    past = bool(stamps) and waiting.stamp_ns < stamps[0]
    far = bool(stamps) and waiting.stamp_ns > stamps[-1] + _FAR_NS
    # reports that go on will never reach a picture of before them, or of another clock
    return waiting.arrived_s if past or far else max(waiting.arrived_s, heard_s)
