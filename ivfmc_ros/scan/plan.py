# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans the sweeps of a scan: start, span, velocity, lasers and view numbers of each.

View numbers (field ``view`` of a profile) count sweep by sweep and, in each sweep, laser by laser.
In step motion the lasers alternate at every stop, so one sweep yields one view per laser. In
continuous motion every view is a sweep of its own: GRBL executes laser commands only after all
queued motion has ended, so the laser cannot change during a move.

A continuous sweep begins where the table stands: the first profile follows after the lead-in. Only
the parts of a turn that is divided into several sweeps have their places relative to the first.

Several exposure times are as many sweeps over the same angles: with one the stripe is clipped
where the part is bright, with another it is lost in noise where it is dark, and the mesh weights
the points of all by their sigma.

Two lasers see a point at two table angles, which shows lost steps of the table. With one laser
the last sweep goes on beyond the turn (``closure``): its end repeats the beginning of the first.

A camera that the table triggers takes a profile after each trigger step in continuous motion: the
step determines their number, and with the rate of the camera the velocity.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import replace
import math
from typing import Any

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.validation import require_in_range

# View number of a laser of the cell that a sweep does not use.
NOT_MEASURED = -1

_TURN = 2.0 * math.pi
# Radians by which the position after a move may exceed its target; a start that is passed by less
# costs no extra turn.
_POSITION_TOLERANCE = 1e-3
# Part of a step that is rounding.
_ROUNDING = 1e-6
# The motion model drops profiles nearer than this to a ramp (seconds), which is found to about
# three profiles.
_LEAD_S, _LEAD_PROFILES = 0.1, 3.0
# A camera below this fraction of the planned rate is limited by its computer, whose load varies
# during a sweep ...
LOW_RATE = 0.9
# ... so that a sweep relies on so much of the rate measured before it.
_SUSTAINED = 0.85


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """
    Limits of the table's motion and of the camera's rate.

    profile_rate : profiles per second that the camera delivers in continuous motion
    velocity, acceleration : rad/s and rad/s^2; the velocity of positioning moves, and the upper
        limit for a sweep
    lead_time : seconds at constant speed before the first profile and after the last one; the
        motion model is fitted to them as well; 0 for 0.1 s and three profiles
    """

    profile_rate: float = 10.0
    velocity: float = 1.5
    acceleration: float = 6.0
    lead_time: float = 0.0

    def __post_init__(self) -> None:
        for key in ('profile_rate', 'velocity', 'acceleration'):
            value = getattr(self, key)
            require_in_range(key, value, 0.0, math.inf, open_low=True, open_high=True)
        require_in_range('lead_time', self.lead_time, 0.0, math.inf, open_high=True)

    @property
    def lead_seconds(self) -> float:
        """Seconds at constant speed before the first profile and after the last one."""
        return self.lead_time or _LEAD_S + _LEAD_PROFILES / self.profile_rate

    def seconds(self, distance: float, velocity: float) -> float:
        """Return the duration, s, of a move of ``distance`` rad with trapezoidal velocity."""
        distance = abs(distance)
        if distance < velocity**2 / self.acceleration:
            # too short to reach the velocity: a triangle
            return 2.0 * math.sqrt(distance / self.acceleration)
        return distance / velocity + velocity / self.acceleration


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """
    One run of the table over a range of angles.

    views : view number of each laser, in the order of the cell; NOT_MEASURED for unused ones
    lasers : names of the used lasers, in the order in which they are switched on
    start, span : table position at the first profile, rad, and the range from there, rad
    profiles : number of profiles of each laser
    closing : how many of them repeat the beginning of the turn, besides the requested overlap
    velocity : rad/s in continuous motion; 0.0 in step motion
    dark : take an image with all lasers off first at every stop
    turns : whole turns that were added to the planned start; negative after homing
    trigger_step : radians between the pulses on which the camera exposes; 0 if it runs freely
    exposure : of the images, seconds; 0 for the camera's own
    retake_of : number of the sweep whose missing angles this one takes again
    """

    number: int
    views: tuple[int, ...]
    lasers: tuple[str, ...]
    start: float
    span: float
    profiles: int
    velocity: float = 0.0
    dark: bool = False
    turns: int = 0
    closing: int = 0
    trigger_step: float = 0.0
    exposure: float = 0.0
    retake_of: int | None = None

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> 'Sweep':
        """
        Return the sweep that ``as_dict`` described.

        :raises ParameterError: a value is missing, or cannot be one of a sweep
        """
        try:
            fields: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value
                for key, value in values.items()
            }
            sweep = cls(**fields)
            numbers = (sweep.start, sweep.span, sweep.velocity, sweep.trigger_step, sweep.exposure)
            is_sound = (
                all(math.isfinite(number) for number in numbers)
                and min(sweep.profiles, len(sweep.lasers), len(sweep.views)) > 0
                and sweep.span > 0.0
                and sweep.exposure >= 0.0
                and sum(view >= 0 for view in sweep.views) == len(sweep.lasers)
            )
        except (TypeError, ValueError, AttributeError) as error:
            raise ParameterError(f'sweep: cannot be read: {error}') from error
        if not is_sound:
            raise ParameterError(f'sweep: is none: {dict(values)}')
        return sweep

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-serializable values."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }

    def angles(self) -> list[float]:
        """Return the table positions of the profiles, radians."""
        step = self.span / self.profiles
        return [self.start + index * step for index in range(self.profiles)]

    def limited_velocity(self, profile_rate: float) -> float:
        """
        Return the velocity, rad/s, at which the camera takes all profiles.

        profile_rate : measured before the sweep, 1/s
        """
        fastest = (self.trigger_step or self.span / self.profiles) * profile_rate
        if fastest < LOW_RATE * self.velocity:
            fastest *= _SUSTAINED
        return min(self.velocity, fastest)

    def lead_angle(self, motion: MotionLimits) -> float:
        """Return the angle, rad, from the start of the move to the first profile."""
        ramp = 0.5 * self.velocity**2 / motion.acceleration
        return ramp + self.velocity * motion.lead_seconds

    def begin(self, motion: MotionLimits) -> float:
        """Return the table position, rad, at which the sweep begins, before the lead-in."""
        return self.start - self.lead_angle(motion)

    def end(self, motion: MotionLimits) -> float:
        """Return the table position, rad, at which the sweep ends, after the lead-out."""
        return self.start + self.span + self.lead_angle(motion)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The sweeps of a scan, in order of execution."""

    sweeps: tuple[Sweep, ...]

    @property
    def views(self) -> int:
        """Number of views."""
        return sum(len(sweep.lasers) for sweep in self.sweeps)

    @property
    def profiles(self) -> int:
        """Number of profiles of all views."""
        return sum(sweep.profiles * len(sweep.lasers) for sweep in self.sweeps)


def make_plan(
    request: ScanRequest,
    lasers: Sequence[str],
    motion: MotionLimits,
    position: float = 0.0,
    trigger_step: float = 0.0,
) -> Plan:
    """
    Plan the sweeps of a scan.

    lasers : names of all lasers of the cell, in its order
    position : of the table when the scan begins, rad; it turns in the positive direction only, so
        that the gear's backlash is always on the same side
    trigger_step : of the cell, radians; in continuous motion the profiles are as many as it gives,
        and not fewer than requested
    :raises ParameterError: the cell has no such laser, the sweep needs a velocity above the
        table's limit, or the trigger does not give so many profiles
    """
    chosen = _chosen(request.lasers, lasers)
    share = _TURN / request.views
    is_step = request.motion == 'step'
    trigger_step = 0.0 if is_step else trigger_step
    request = _with_triggered_profiles(request, trigger_step)
    groups = [chosen] if is_step else [[one] for one in chosen]
    exposed = [(group, seconds) for group in groups for seconds in request.exposures or (0.0,)]
    # start of the first part of the turn, for each group of lasers and exposure
    starts: list[float] = []
    sweeps: list[Sweep] = []
    for part in range(request.views):
        for number, (group, exposure) in enumerate(exposed):
            is_last = part == request.views - 1 and number == len(exposed) - 1
            closing = _closing_profiles(request) if len(chosen) == 1 and is_last else 0
            sweep = Sweep(
                number=len(sweeps),
                views=_view_numbers(sum(len(one.lasers) for one in sweeps), group, lasers),
                lasers=tuple(group),
                start=0.0,
                span=(share + request.overlap) * (1.0 + closing / request.profiles),
                profiles=request.profiles + closing,
                velocity=_velocity(request, motion, trigger_step),
                trigger_step=trigger_step,
                exposure=exposure,
                dark=request.dark_frames and is_step,
                closing=closing,
            )
            if part == 0:
                starts.append(0.0 if is_step else position + sweep.lead_angle(motion))
            sweep = replace(sweep, start=starts[number] + part * share)
            sweeps.append(after_position(sweep, motion, position))
            position = sweeps[-1].end(motion)
    return Plan(sweeps=tuple(sweeps))


def require_steps(plan: Plan, least: float, limit: str) -> None:
    """
    Check that the stops of step motion can be told apart.

    least : radians, 0 for any step
    limit : what it is, for the error
    :raises ParameterError: the steps of a sweep are smaller
    """
    for sweep in plan.sweeps:
        step = sweep.span / sweep.profiles
        if sweep.velocity == 0.0 and step < least:
            raise ParameterError(
                f'profiles: {sweep.profiles} of a view are {math.degrees(step):.4f} degrees '
                f'apart, the {limit} is {math.degrees(least):.4f}; '
                f'request {math.floor((sweep.profiles - sweep.closing) * step / least)} or fewer, '
                'or reduce it'
            )


def _chosen(requested: Sequence[str], lasers: Sequence[str]) -> list[str]:
    unknown = [name for name in requested if name not in lasers]
    if unknown:
        raise ParameterError(
            f'lasers: {unknown[0]!r} is not in the cell; it has {", ".join(lasers)}'
        )
    return [name for name in lasers if not requested or name in requested]


def _view_numbers(first: int, group: Sequence[str], lasers: Sequence[str]) -> tuple[int, ...]:
    return tuple(first + group.index(name) if name in group else NOT_MEASURED for name in lasers)


def _closing_profiles(request: ScanRequest) -> int:
    """Return the number of profiles that are added to the last sweep, in its steps."""
    step = (_TURN / request.views + request.overlap) / request.profiles
    return max(0, math.ceil((request.closure - request.overlap) / step - _ROUNDING))


def _with_triggered_profiles(request: ScanRequest, trigger_step: float) -> ScanRequest:
    """:raises ParameterError: the trigger gives fewer profiles of a view than requested."""
    if not trigger_step:
        return request
    span = _TURN / request.views + request.overlap
    count = math.floor(span / trigger_step + _ROUNDING)
    if request.profiles > count:
        raise ParameterError(
            f'profiles: {request.profiles} of a view were requested, the trigger gives {count}: '
            f'one each {math.degrees(trigger_step):.4g} degrees (trigger_step of cell.yaml); '
            f'request {count} or fewer'
        )
    return replace(request, profiles=count)


def _velocity(request: ScanRequest, motion: MotionLimits, trigger_step: float) -> float:
    if request.motion == 'step':
        return 0.0
    if trigger_step:
        # a slower table takes the same profiles
        return min(trigger_step * motion.profile_rate, motion.velocity)
    span = _TURN / request.views + request.overlap
    velocity = span / request.profiles * motion.profile_rate
    if velocity > motion.velocity:
        least = math.ceil(span * motion.profile_rate / motion.velocity)
        raise ParameterError(
            f'profiles: {request.profiles} at {motion.profile_rate:g} per second need a table '
            f'velocity of {velocity:.2f} rad/s, the limit is {motion.velocity:g}; '
            f'request {least} or more'
        )
    return velocity


def after_position(sweep: Sweep, motion: MotionLimits, position: float) -> Sweep:
    """
    Return the sweep with whole turns added to its start, so that it begins next after a position.

    Turns are taken away where the position is more than one before it, as after homing.

    position : rad; the table turns in the positive direction only
    """
    behind = position - sweep.begin(motion) - _POSITION_TOLERANCE
    turns = math.ceil(behind / _TURN)
    return replace(sweep, start=sweep.start + turns * _TURN, turns=sweep.turns + turns)
