# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fit of the table's motion during a sweep: true table angles from delayed position reports.

A motion controller answers 5 to 20 ms after the table was at the reported position, with a delay
that varies: at 24 degrees a second this is up to half a degree. Between lead-in and lead-out the
table turns at constant speed, so that a line fitted to all reports is more accurate than each.

The line is fitted to the stamps and provisional angles of the profiles, which were interpolated
from the reports. No other data are needed, and a sweep gives the same result live, replayed and
reconstructed. A constant delay only rotates the whole part.
"""

from collections import defaultdict
from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile
from ivfmc_ros.registration.views.trigger_grid import TriggerCheck

# The table stands below this speed, rad/s: it moves 0.04 mrad in the 20 ms of a delay.
_MIN_SPEED = 2e-3
# Least number of profiles, and duration in seconds, of a section to which a speed is fitted.
_MIN_PROFILES = 12
_MIN_SECONDS = 0.5
# Reports are delayed by up to 20 ms; a larger lag, seconds, belongs to a ramp.
_MAX_JITTER_S = 0.025
# A section with a larger rms of the jitter, seconds, was not taken at constant speed.
_MAX_RMS_S = 0.05
# Distance in time from the detected end of a ramp, seconds.
_CLEARANCE_S = 0.1
# Limit of the iterations of a robust fit; it converges in fewer.
_MAX_ITERATIONS = 20
# A sweep with a longer interruption, seconds, is fitted in two sections, unless one line fits
# both: the mean delays of the reports differ by milliseconds, which turns one against the other.
_PAUSE_S = 0.5
# Share of the profiles of both that have to lie on the common line.
_MIN_COMMON = 0.95
# A continuous scan stands at few angles (before, between and after sweeps), a stepped one at many.
_MAX_RESTS = 6
# Huber's threshold, in robust deviations.
_HUBER = 1.5
# Profiles from which the end of a ramp is extrapolated, and the farthest extrapolation, seconds.
_RAMP_PROFILES = 6
_MAX_EXTRAPOLATION_S = 0.5


@dataclass(frozen=True, kw_only=True)
class SweepMotion:
    """
    Motion of the table during one view.

    view : number of the view
    speed : rad/s of the longest section; 0 if the table stood at each profile
    jitter : seconds, rms of the reported positions about the fitted motion
    used, dropped : number of profiles at constant speed, and in a lead-in or lead-out
    why : reason why the reported angles were kept although the table turned; else empty
    trigger : numbering of the pictures by the steps of the trigger; None for a camera that the
        table does not trigger
    """

    view: int
    speed: float = 0.0
    jitter: float = 0.0
    used: int = 0
    dropped: int = 0
    why: str = ''
    trigger: TriggerCheck | None = None


def refit(profiles: Iterable[Profile]) -> tuple[list[Profile], list[SweepMotion]]:
    """
    Replace the provisional table angles by those of the fitted motion, for each view.

    Points are rotated about the axis by the change of their angle. Profiles of a lead-in or
    lead-out are dropped. A view is unchanged if the table stood at its profiles, or did not turn
    at a constant speed.
    A view that was interrupted before the table turned at constant speed is left out where other
    views were taken in motion: the angles of its few profiles are those of single reports.

    returns : the profiles sorted by view and stamp, and the motion of each view
    """
    views: dict[int, list[Profile]] = defaultdict(list)
    for profile in profiles:
        views[profile.view].append(profile)
    ordered = {
        number: sorted(views[number], key=lambda p: (p.stamp_ns, p.seq))
        for number in sorted(views)
    }
    fitted = {number: _refit_view(number, view) for number, view in ordered.items()}
    is_continuous = any(motion.speed for _, motion in fitted.values())
    found: list[Profile] = []
    motions = []
    for number, (turned, motion) in fitted.items():
        if is_continuous and not motion.speed and _is_interrupted(ordered[number]):
            why = 'interrupted before the table turned at a constant speed; the view is left out'
            motions.append(SweepMotion(view=number, dropped=len(ordered[number]), why=why))
            continue
        found += turned
        motions.append(motion)
    return found, motions


def _is_interrupted(profiles: Sequence[Profile]) -> bool:
    """Return whether the profiles are those of a lead-in: at few angles, and few in motion."""
    angles = np.array([p.angle for p in profiles])
    moving = np.abs(_smooth(np.array([p.speed for p in profiles]))) > _MIN_SPEED
    return bool(np.count_nonzero(moving) < _MIN_PROFILES and _rests(angles, moving) <= _MAX_RESTS)


def _refit_view(number: int, profiles: Sequence[Profile]) -> tuple[list[Profile], SweepMotion]:
    stamps = np.array([p.stamp_ns for p in profiles], dtype=np.int64)
    angles = np.array([p.angle for p in profiles])
    # a single delayed report would look like a standing or reversing table
    speeds = _smooth(np.array([p.speed for p in profiles]))
    if _is_stepped(angles, np.abs(speeds) > _MIN_SPEED):
        return list(profiles), SweepMotion(view=number, used=len(profiles))
    runs = _runs(stamps, speeds)
    sections = _joined(
        stamps, angles, [s for s in (_section(stamps, angles, run) for run in runs) if s]
    )
    if not sections:
        why = 'the table turned, but not at a constant speed; the reported angles are used'
        return list(profiles), SweepMotion(view=number, used=len(profiles), why=why)
    turned = [
        turned_to(profiles[index], angle)
        for section in sections
        for index, angle in zip(section.chosen, section.angles, strict=True)
    ]
    longest = max(sections, key=lambda section: len(section.chosen))
    residuals = np.concatenate([section.jitter for section in sections])
    return turned, SweepMotion(
        view=number,
        speed=longest.speed,
        jitter=float(np.sqrt(np.mean(residuals**2))),
        used=len(turned),
        dropped=len(profiles) - len(turned),
    )


def _is_stepped(angles: Floats, moving: Bools) -> bool:
    """Return whether the scan was stepped: the table stood at most profiles, at many angles."""
    if not moving.any():
        return True
    is_half = bool(2 * np.count_nonzero(moving) <= len(angles))
    return is_half and _rests(angles, moving) > _MAX_RESTS


def _rests(angles: Floats, moving: Bools) -> int:
    """Return at how many angles the table stood."""
    return len(np.unique(np.round(angles[~moving], 3)))


def _runs(stamps: Ints, speeds: Floats) -> list[Ints]:
    """Return the indices of the profiles of each uninterrupted motion in one direction."""
    indices = np.flatnonzero(np.abs(speeds) > _MIN_SPEED)
    if not len(indices):
        return []
    pause = np.diff(stamps[indices]) * 1e-9
    apart = pause > _PAUSE_S + 5.0 * np.median(pause) if len(pause) else pause > 0
    back = np.diff(np.sign(speeds[indices])) != 0
    broken = (np.diff(indices) > 1) | apart | back
    return list(np.split(indices, np.flatnonzero(broken) + 1))


@dataclass(frozen=True, eq=False)
class _Section:
    """
    Part of a sweep at constant speed.

    chosen : (n,) indices of profiles
    angles : (n,) radians, of the fit
    jitter : (n,) seconds by which the reports were early (negative: late)
    speed : rad/s
    """

    chosen: Ints
    angles: Floats
    jitter: Floats
    speed: float


def _section(stamps: Ints, angles: Floats, run: Ints) -> _Section | None:
    """Fit the part of a run at constant speed; None if there is none."""
    if len(run) < _MIN_PROFILES:
        return None
    # epoch stamps lose 200 ns as float64 seconds; differences are exact
    seconds = (stamps[run] - stamps[run[0]]) * 1e-9
    values = angles[run]
    inside = np.ones(len(run), dtype=bool)
    for _ in range(_MAX_ITERATIONS):
        if np.count_nonzero(inside) < _MIN_PROFILES or np.ptp(seconds[inside]) < _MIN_SECONDS:
            return None
        speed, offset = _line(seconds[inside], values[inside])
        if abs(speed) <= _MIN_SPEED:
            return None
        late = (values - offset) / speed - seconds
        between = _between_ramps(seconds, late)
        if (between == inside).all():
            break
        inside = between
    jitter = late[inside]
    if np.sqrt(np.mean(jitter**2)) > _MAX_RMS_S:
        return None
    fitted = offset + speed * seconds[inside]
    return _Section(run[inside], fitted, jitter, float(speed))


def _joined(stamps: Ints, angles: Floats, sections: Sequence[_Section]) -> list[_Section]:
    """Return the sections, as one where the table turned on through an interruption."""
    found: list[_Section] = []
    for section in sections:
        both = _common_section(stamps, angles, found[-1], section) if found else None
        if both is None:
            found.append(section)
        else:
            found[-1] = both
    return found


def _common_section(
    stamps: Ints, angles: Floats, first: _Section, second: _Section
) -> _Section | None:
    """Return the section of the line that fits two sections; None if none does."""
    if first.speed * second.speed < 0.0:
        return None
    chosen = np.concatenate([first.chosen, second.chosen])
    both = _section(stamps, angles, chosen)
    is_common = both is not None and len(both.chosen) >= _MIN_COMMON * len(chosen)
    return both if is_common else None


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return slope and offset of a line through (n,) points, robust to outliers (Huber)."""
    # initial line from the median of slopes over half the length: robust to outliers and ramps
    half = len(x) // 2
    slope = float(np.median((y[half:] - y[: len(y) - half]) / (x[half:] - x[: len(x) - half])))
    offset = float(np.median(y - slope * x))
    for _ in range(_MAX_ITERATIONS):
        residual = y - offset - slope * x
        scale = 1.4826 * float(np.median(np.abs(residual)))
        if scale <= 1e-12:
            break
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(residual), 1e-15))
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        dx = x - mean_x
        slope = float((weight * dx * (y - mean_y)).sum() / (weight * dx * dx).sum())
        offset = float(mean_y - slope * mean_x)
    return slope, offset


def _between_ramps(seconds: Floats, late: Floats) -> Bools:
    """
    Return which profiles lie between the lead-in and the lead-out, (n,) bool.

    In a ramp the lag against the line grows steadily, unlike that of single delayed reports.
    The lag is therefore smoothed by a running median.

    late : (n,) seconds, lag of each report against the line
    """
    off = np.abs(_smooth(late) - np.median(late)) > _MAX_JITTER_S
    middle = np.searchsorted(seconds, 0.5 * (seconds[0] + seconds[-1]))
    begin, end = seconds[0], seconds[-1]
    if off[:middle].any():
        begin = _ramp_end(seconds[:middle], late[:middle], off[:middle])
    if off[middle:].any():
        end = -_ramp_end(-seconds[middle:][::-1], late[middle:][::-1], off[middle:][::-1])
    return np.asarray((seconds >= begin) & (seconds <= end))


def _smooth(values: Floats) -> Floats:
    """Return the running median of (n,) values over five neighbors."""
    padded = np.pad(values, 2, mode='edge')
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def _ramp_end(seconds: Floats, late: Floats, off: Bools) -> float:
    """
    Return when the ramp at the beginning of (n,) ascending seconds ends, seconds.

    At constant acceleration the lag grows with the square of the time before the ramp's end: its
    square root is a line, which is extrapolated to zero.

    off : (n,) bool, profiles whose lag shows the ramp
    """
    last = int(np.flatnonzero(off)[-1])
    ramp = np.flatnonzero(off[: last + 1])[-_RAMP_PROFILES:]
    end = float(seconds[last])
    root = np.sqrt(np.abs(late[ramp]))
    if len(ramp) >= 3 and np.ptp(seconds[ramp]) > 0:
        slope, offset = np.polyfit(seconds[ramp], root, 1)
        zero = -offset / slope if slope < 0 else end
        end = float(np.clip(zero, end, end + _MAX_EXTRAPOLATION_S))
    return end + _CLEARANCE_S


def turned_to(profile: Profile, angle: float) -> Profile:
    """Return the profile at another table angle, radians: its points turn about the axis."""
    change = float(angle) - profile.angle
    return replace(
        profile,
        points_xyz=profile.points_xyz @ transforms.rotation_z(-change).T,
        angle=float(angle),
    )
