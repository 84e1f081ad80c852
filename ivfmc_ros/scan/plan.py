# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which sweeps a scan takes, and which profiles of which laser belong to which view.

View numbers are those of ``profile.view``: sweep by sweep of the turn, and in each sweep laser by
laser. In step motion the lasers take turns at every stop, so that one sweep makes a view of each;
in continuous motion every view is a sweep of its own, because a board that switches its laser
lines only when motion has ended cannot change them under way.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.validation import require_in_range

NOT_MEASURED = -1

_TURN = 2.0 * math.pi


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """
    What the table can do and how long a sweep needs to be smooth.

    profile_rate : profiles a second that the camera gives in continuous motion
    velocity, acceleration : rad/s and rad/s^2; the velocity is that of steps, and the most that a
        sweep may have
    lead_time : seconds at constant speed before the first profile and after the last; the motion
        model is fitted to them, too
    """

    profile_rate: float = 10.0
    velocity: float = 1.5
    acceleration: float = 6.0
    lead_time: float = 0.4

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            require_in_range(key, value, 0.0, math.inf, open_low=True, open_high=True)

    def seconds(self, distance: float, velocity: float) -> float:
        """Return how long a move of so many radians takes, with its ramps."""
        return abs(distance) / velocity + velocity / self.acceleration


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """
    One run of the table.

    views : view number of each laser of the cell, in its order; NOT_MEASURED for the others
    lasers : names of those that are measured, in the order in which they shine
    start, span : radians of table position at the first profile, and from there to the end
    profiles : of each laser
    velocity : rad/s while profiles are taken; 0.0 where the table stands for each of them
    dark : a picture with all lasers off comes first at every stop
    """

    number: int
    views: tuple[int, ...]
    lasers: tuple[str, ...]
    start: float
    span: float
    profiles: int
    velocity: float = 0.0
    dark: bool = False

    def angles(self) -> list[float]:
        """Return the table positions of the profiles, radians."""
        step = self.span / self.profiles
        return [self.start + index * step for index in range(self.profiles)]

    def slowed(self, rate: float) -> float:
        """Return the velocity, rad/s, at which so many profiles a second are not too few."""
        return min(self.velocity, self.span / self.profiles * rate)

    def lead(self, motion: MotionLimits) -> float:
        """Return how far before the first profile the table starts to move, radians."""
        ramp = 0.5 * self.velocity**2 / motion.acceleration
        return ramp + self.velocity * motion.lead_time


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All sweeps of a scan, in their order."""

    sweeps: tuple[Sweep, ...]

    @property
    def views(self) -> int:
        """How many views there will be."""
        return sum(len(sweep.lasers) for sweep in self.sweeps)

    @property
    def profiles(self) -> int:
        """How many profiles of all views are asked for."""
        return sum(sweep.profiles * len(sweep.lasers) for sweep in self.sweeps)


def make_plan(
    request: ScanRequest, lasers: Sequence[str], motion: MotionLimits, position: float = 0.0
) -> Plan:
    """
    Plan the sweeps of a scan.

    lasers : names of all lasers of the cell, in its order
    position : of the table now, radians; it only ever turns forward, so that play in its gear is
        always on the same side
    :raises ParameterError: a laser is not of the cell, or the sweep is faster than the table
    """
    chosen = _chosen(request.lasers, lasers)
    share = _TURN / request.views
    span = share + request.overlap
    sweeps: list[Sweep] = []
    for part in range(request.views):
        for group in [chosen] if request.motion == 'step' else [[one] for one in chosen]:
            sweep = Sweep(
                number=len(sweeps),
                views=_numbers(part, group, chosen, lasers),
                lasers=tuple(group),
                start=part * share,
                span=span,
                profiles=request.profiles,
                velocity=_velocity(request, span, motion),
                dark=request.dark_frames and request.motion == 'step',
            )
            sweeps.append(_ahead(sweep, motion, position))
            position = sweeps[-1].start + span + sweeps[-1].lead(motion)
    return Plan(sweeps=tuple(sweeps))


def _chosen(wanted: Sequence[str], lasers: Sequence[str]) -> list[str]:
    unknown = [name for name in wanted if name not in lasers]
    if unknown:
        raise ParameterError(
            f'lasers: {unknown[0]!r} is not in the cell; it has {", ".join(lasers)}'
        )
    return [name for name in lasers if not wanted or name in wanted]


def _numbers(
    part: int, group: Sequence[str], chosen: Sequence[str], lasers: Sequence[str]
) -> tuple[int, ...]:
    first = part * len(chosen)
    return tuple(first + chosen.index(name) if name in group else NOT_MEASURED for name in lasers)


def _velocity(request: ScanRequest, span: float, motion: MotionLimits) -> float:
    if request.motion == 'step':
        return 0.0
    velocity = span / request.profiles * motion.profile_rate
    if velocity > motion.velocity:
        least = math.ceil(span * motion.profile_rate / motion.velocity)
        raise ParameterError(
            f'profiles: {request.profiles} at {motion.profile_rate:g} a second would take the '
            f'table {velocity:.2f} rad/s, it may have {motion.velocity:g}; ask for {least} or more'
        )
    return velocity


def _ahead(sweep: Sweep, motion: MotionLimits, position: float) -> Sweep:
    """Return the sweep with its start whole turns ahead, so that the table need not go back."""
    # a table that has arrived is not exactly where it was sent
    arrived = 1e-3
    behind = position - (sweep.start - sweep.lead(motion)) - arrived
    turns = max(0, math.ceil(behind / _TURN))
    return Sweep(**{**vars(sweep), 'start': sweep.start + turns * _TURN})
