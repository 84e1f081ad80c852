# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How the table really turned while a sweep was taken.

A board answers 5 to 20 ms after the table was where it says, each time another delay: at 24
degrees a second that is up to half a degree. Between its lead-in and its lead-out the table turns
at constant speed, so that a straight line through all reports knows better than each of them.

The line is fitted to the profiles themselves, to their stamps and the angles that were
interpolated from the reports. So whoever has the profiles has all that the fit needs, and a sweep
is the same live, replayed and reconstructed. A constant delay only turns the whole part.
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

# Slower than this, rad/s, the table stands: 20 ms of it are 0.04 mrad.
_STANDS = 2e-3
# A section with fewer profiles, or shorter (seconds), has no speed that could be fitted.
_LEAST_PROFILES = 12
_LEAST_SECONDS = 0.5
# Answers come up to 20 ms late; what is off by more than this is no constant speed.
_JITTER_S = 0.025
# If they differ by so much (rms, seconds), it was not the table's answer that was late.
_WORST_RMS_S = 0.05
# Kept clear of where a ramp was seen to end, seconds.
_CLEARANCE_S = 0.1
_ROUNDS = 20
# A sweep that is interrupted this long, seconds, is two.
_PAUSE_S = 0.5
# Before, between and after sweeps the table stands in a few places; in a stepped scan in many.
_MOST_RESTS = 6


@dataclass(frozen=True, kw_only=True)
class Motion:
    """
    How the table turned while one view was taken.

    speed : radians per second of the longest section; 0 where it stood at each profile
    jitter : seconds, rms of the reported positions about the fitted motion
    used, dropped : profiles at constant speed, and those of a lead-in or lead-out
    why : says so where the reported angles were kept although the table turned
    """

    view: int
    speed: float = 0.0
    jitter: float = 0.0
    used: int = 0
    dropped: int = 0
    why: str = ''


def refit(profiles: Iterable[Profile]) -> tuple[list[Profile], list[Motion]]:
    """
    Replace provisional angles by those of the fitted motion, each view by itself.

    Points are turned about the axis by what their angle changes. Profiles of a lead-in or a
    lead-out are left out. A view whose profiles were taken while the table stood comes back as
    it is, and so does one whose table did not turn at a constant speed.

    returns : the profiles by view and stamp, and how each view was taken
    """
    views: dict[int, list[Profile]] = defaultdict(list)
    for profile in profiles:
        views[profile.view].append(profile)
    found: list[Profile] = []
    motions = []
    for number in sorted(views):
        ordered = sorted(views[number], key=lambda p: (p.stamp_ns, p.seq))
        turned, motion = _refit_view(number, ordered)
        found += turned
        motions.append(motion)
    return found, motions


def _refit_view(number: int, profiles: Sequence[Profile]) -> tuple[list[Profile], Motion]:
    stamps = np.array([p.stamp_ns for p in profiles], dtype=np.int64)
    angles = np.array([p.angle for p in profiles])
    # one report that came late makes the table seem to stand or to turn back
    speeds = _smooth(np.array([p.speed for p in profiles]))
    if _is_stepped(angles, np.abs(speeds) > _STANDS):
        return list(profiles), Motion(view=number, used=len(profiles))
    runs = _runs(stamps, speeds)
    sections = [s for s in (_section(stamps, angles, run) for run in runs) if s]
    if not sections:
        why = 'the table turned, but not at a constant speed; the reported angles are used'
        return list(profiles), Motion(view=number, used=len(profiles), why=why)
    turned = [
        _turned(profiles[index], angle)
        for section in sections
        for index, angle in zip(section.chosen, section.angles, strict=True)
    ]
    longest = max(sections, key=lambda section: len(section.chosen))
    residuals = np.concatenate([section.jitter for section in sections])
    return turned, Motion(
        view=number,
        speed=longest.speed,
        jitter=float(np.sqrt(np.mean(residuals**2))),
        used=len(turned),
        dropped=len(profiles) - len(turned),
    )


def _is_stepped(angles: Floats, moving: Bools) -> bool:
    """Tell whether the table stood at the profiles: before and after a sweep, it stands once."""
    if not moving.any():
        return True
    places = len(np.unique(np.round(angles[~moving], 3)))
    return places > _MOST_RESTS and bool(2 * np.count_nonzero(moving) <= len(angles))


def _runs(stamps: Ints, speeds: Floats) -> list[Ints]:
    """Return the indices of the profiles of each unbroken turn of the table in one direction."""
    indices = np.flatnonzero(np.abs(speeds) > _STANDS)
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
    A part of a sweep at constant speed.

    chosen : (n,) indices of profiles; angles : (n,) radians, of the fit
    jitter : (n,) seconds by which the reports were early (negative: late)
    """

    chosen: Ints
    angles: Floats
    jitter: Floats
    speed: float


def _section(stamps: Ints, angles: Floats, run: Ints) -> _Section | None:
    """Fit the part of a run that was taken at constant speed; None if there is none."""
    if len(run) < _LEAST_PROFILES:
        return None
    # stamps of today lose 200 ns as float64 seconds, their differences nothing
    seconds = (stamps[run] - stamps[run[0]]) * 1e-9
    values = angles[run]
    inside = np.ones(len(run), dtype=bool)
    for _ in range(_ROUNDS):
        if np.count_nonzero(inside) < _LEAST_PROFILES or np.ptp(seconds[inside]) < _LEAST_SECONDS:
            return None
        speed, offset = _line(seconds[inside], values[inside])
        if abs(speed) <= _STANDS:
            return None
        late = (values - offset) / speed - seconds
        steady = _between_ramps(seconds, late)
        if (steady == inside).all():
            break
        inside = steady
    jitter = late[inside]
    if np.sqrt(np.mean(jitter**2)) > _WORST_RMS_S:
        return None
    fitted = offset + speed * seconds[inside]
    return _Section(run[inside], fitted, jitter, float(speed))


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return slope and offset of a line through (n,) points, whatever some of them say."""
    # a start that outliers and ramps at the ends cannot pull: the median of long slopes
    half = len(x) // 2
    slope = float(np.median((y[half:] - y[: len(y) - half]) / (x[half:] - x[: len(x) - half])))
    offset = float(np.median(y - slope * x))
    for _ in range(_ROUNDS):
        residual = y - offset - slope * x
        scale = 1.4826 * float(np.median(np.abs(residual)))
        if scale <= 1e-12:
            break
        # Huber's weights: answers that are very late count, but no more than late ones
        weight = np.minimum(1.0, 1.5 * scale / np.maximum(np.abs(residual), 1e-15))
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        dx = x - mean_x
        slope = float((weight * dx * (y - mean_y)).sum() / (weight * dx * dx).sum())
        offset = float(mean_y - slope * mean_x)
    return slope, offset


def _between_ramps(seconds: Floats, late: Floats) -> Bools:
    """
    Tell which profiles lie between the lead-in and the lead-out.

    In a ramp the table is behind (lead-in) or ahead of the line by more and more; answers that
    are late once are not. What counts is therefore the median of neighbours.
    """
    off = np.abs(_smooth(late) - np.median(late)) > _JITTER_S
    middle = np.searchsorted(seconds, 0.5 * (seconds[0] + seconds[-1]))
    begin, end = seconds[0], seconds[-1]
    if off[:middle].any():
        begin = _ramp_end(seconds[:middle], late[:middle], off[:middle])
    if off[middle:].any():
        end = -_ramp_end(-seconds[middle:][::-1], late[middle:][::-1], off[middle:][::-1])
    return np.asarray((seconds >= begin) & (seconds <= end))


def _smooth(values: Floats) -> Floats:
    """Return the median of each of (n,) values and its two neighbours on either side."""
    padded = np.pad(values, 2, mode='edge')
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def _ramp_end(seconds: Floats, late: Floats, off: Bools) -> float:
    """
    Return when the ramp at the beginning of (n,) ascending seconds is over.

    At constant acceleration the lag grows with the square of the time before the ramp's end: its
    root is a line, which is followed to where the lag is nothing.
    """
    last = int(np.flatnonzero(off)[-1])
    ramp = np.flatnonzero(off[: last + 1])[-6:]
    end = float(seconds[last])
    root = np.sqrt(np.abs(late[ramp]))
    if len(ramp) >= 3 and np.ptp(seconds[ramp]) > 0:
        slope, offset = np.polyfit(seconds[ramp], root, 1)
        zero = -offset / slope if slope < 0 else end
        # a ramp that is hardly seen says little about its end
        end = float(np.clip(zero, end, end + 0.5))
    return end + _CLEARANCE_S


def _turned(profile: Profile, angle: float) -> Profile:
    change = float(angle) - profile.angle
    return replace(
        profile,
        points_xyz=profile.points_xyz @ transforms.rotation_z(-change).T,
        angle=float(angle),
    )
