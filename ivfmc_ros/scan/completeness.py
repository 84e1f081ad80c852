# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compares the profiles of a scan with its plan: number, greatest gap in angle, share with a stripe.

Angles are compared in the frame of the planned sweep: table positions without the whole turns that
the triangulator leaves out, and without those that a repeated sweep begins later.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import math
from typing import Any

from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import NOT_MEASURED
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.storage.matching.image_loss import ImageLoss
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.validation import require_in_range

_TURN = 2.0 * math.pi

# A repeated sweep begins and ends this many steps outside of the missing angles.
_MARGIN_STEPS = 3.0
# Least number of profiles of a repeated sweep: the motion model is fitted to 12 or more.
_MIN_RETAKEN = 20
# With more holes the range that holds all of them is taken again in one sweep.
_MAX_HOLES = 3
# The table stops within this many steps of a planned angle.
_TOLERANCE_STEPS = 0.1
# Angle differences below this, radians, are rounding: angles are published in single precision.
_ROUNDING = 1e-4

# A range of angles, from and to, radians.
Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class CompletenessLimits:
    """
    What a complete view has at least.

    max_gap : greatest difference in angle of neighboring profiles, in planned steps
    min_profiles : share of the planned profiles that were received, 0 to 1
    min_stripe : share of the profiles that have a point, 0 to 1; a part that is off the axis is
        not in the light sheet at all angles
    """

    max_gap: float = 3.5
    min_profiles: float = 0.6
    min_stripe: float = 0.05

    def __post_init__(self) -> None:
        require_in_range('max_gap', self.max_gap, 1.5, 1e6)
        require_in_range('min_profiles', self.min_profiles, 0.0, 1.0)
        require_in_range('min_stripe', self.min_stripe, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class ViewCoverage:
    """
    What came of a planned view, the views that were taken again included.

    planned, profiles : planned and received number of profiles in the planned range of angles
    largest_gap : greatest difference in angle of neighboring profiles, radians
    missing : ranges of angles without profiles, radians of the table position
    stripe : share of the profiles that have a point
    retaken : numbers of the views that were taken again
    why : why the view is incomplete, '' where it is complete
    """

    view: int
    laser: str
    planned: int
    profiles: int
    largest_gap: float
    missing: tuple[Range, ...]
    stripe: float
    retaken: tuple[int, ...] = ()
    why: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-serializable values; angles in degrees."""
        return {
            'view': self.view,
            'laser': self.laser,
            'planned': self.planned,
            'profiles': self.profiles,
            'largest_gap_deg': round(math.degrees(self.largest_gap), 2),
            'missing_deg': [degrees_of(hole) for hole in self.missing],
            'stripe_share': round(self.stripe, 3),
            'retaken_as': list(self.retaken),
        }


class Completeness:
    """Collects the sweeps that were executed and compares them with the received profiles."""

    def __init__(
        self, plan: Plan, motion: MotionLimits, limits: CompletenessLimits | None = None
    ) -> None:
        self._limits = limits or CompletenessLimits()
        self._motion = motion
        self._next_view = plan.views
        self._sweeps: dict[int, Sweep] = {}
        self._retakes: dict[int, list[Sweep]] = {}

    def begin(self, sweep: Sweep) -> None:
        """Note that a sweep is executed now."""
        if sweep.retake_of is None:
            self._sweeps[sweep.number] = sweep
        else:
            self._retakes.setdefault(sweep.retake_of, []).append(sweep)

    def retakes(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Sweep]:
        """
        Return the sweeps that take the missing angles of a continuous sweep again.

        Each is a view of its own, because the table motion is fitted for each view. In step motion
        every profile is waited for, so that there is nothing to take again.

        headers : of all profiles of the scan, by number
        """
        if not sweep.velocity > 0.0:
            return []
        runs = self._header_runs(sweep, sweep.lasers[0], headers)
        holes = self._holes(sweep, runs)
        if self._count(sweep, runs) < self._limits.min_profiles * sweep.profiles:
            holes = [self._range(sweep)]
        if len(holes) > _MAX_HOLES:
            holes = [(holes[0][0], holes[-1][1])]
        return [self._retake(sweep, hole) for hole in holes]

    def coverage(
        self,
        headers: Mapping[int, ProfileHeader],
        registered: Sequence[Mapping[str, Any]] = (),
    ) -> list[ViewCoverage]:
        """
        Compare every planned view with what came.

        headers : of all profiles of the scan, by number
        registered : summaries of the registered views (view, runs), as the registrar answers; a
            view may have lost profiles since they were received
        """
        return [
            self._coverage(sweep, laser, headers, registered)
            for sweep in self._sweeps.values()
            for laser in sweep.lasers
        ]

    def lost_images(
        self, headers: Mapping[int, ProfileHeader], info_stamps_ns: Sequence[int]
    ) -> dict[str, int]:
        """
        Count the images of continuous sweeps that became no profile.

        info_stamps_ns : stamps of all camera_info of the scan
        :returns: not_received: images without a profile although their camera_info was received;
            not_taken: missing by the frame rate; a triggered camera has none, and the registrar
            counts the triggers without an image
        """
        found = {'not_received': 0, 'not_taken': 0}
        taken = [*self._sweeps.values(), *(one for many in self._retakes.values() for one in many)]
        for sweep in taken:
            stamps = sorted(h.stamp_ns for h in headers.values() if h.view in sweep.views)
            if not stamps or not sweep.velocity > 0.0:
                continue
            loss = ImageLoss()
            inside = [s for s in info_stamps_ns if stamps[0] <= s <= stamps[-1]]
            events = [(s, loss.add_info) for s in inside] + [(s, loss.add_image) for s in stamps]
            for stamp_ns, add in sorted(events, key=lambda event: event[0]):
                add(stamp_ns)
            loss.finish()
            found['not_received'] += loss.not_received
            found['not_taken'] += 0 if sweep.trigger_step else loss.not_taken
        return found

    def _coverage(
        self,
        sweep: Sweep,
        laser: str,
        headers: Mapping[int, ProfileHeader],
        registered: Sequence[Mapping[str, Any]],
    ) -> ViewCoverage:
        begin, end = self._range(sweep)
        runs = self._header_runs(sweep, laser, headers)
        numbers = self._numbers(sweep, laser)
        own = [header for header in headers.values() if header.view in numbers]
        holes, gaps = self._holes(sweep, runs), _gaps(begin, end, runs)
        kept = self._registered_runs(sweep, laser, headers, registered)
        if kept is not None:
            # what the registrar dropped is missing, too
            holes = sorted({*holes, *self._holes(sweep, kept)})
            gaps += _gaps(begin, end, kept)
        coverage = ViewCoverage(
            view=min(numbers),
            laser=laser,
            planned=sweep.profiles,
            profiles=self._count(sweep, runs),
            largest_gap=max((high - low for low, high in gaps), default=0.0),
            missing=tuple(_without_turns(hole) for hole in _merged(holes)),
            stripe=sum(header.points > 0 for header in own) / len(own) if own else 0.0,
            retaken=tuple(sorted(numbers)[1:]),
        )
        return replace(coverage, why=_reason(coverage, self._limits))

    def _retake(self, sweep: Sweep, hole: Range) -> Sweep:
        step = sweep.span / sweep.profiles
        begin, end = hole[0] - _MARGIN_STEPS * step, hole[1] + _MARGIN_STEPS * step
        short = max(0.0, _MIN_RETAKEN * step - (end - begin))
        begin, end = begin - 0.5 * short, end + 0.5 * short
        if end - begin >= sweep.span:
            begin, end = self._range(sweep)
        views = tuple(NOT_MEASURED if v < 0 else self._next_view for v in sweep.views)
        self._next_view += 1
        return replace(
            sweep,
            views=views,
            start=begin,
            span=end - begin,
            profiles=math.ceil((end - begin) / step - _ROUNDING),
            turns=0,
            retake_of=sweep.number,
        )

    @staticmethod
    def _range(sweep: Sweep) -> Range:
        """Return the angles of the first and of the last planned profile."""
        is_step = not sweep.velocity > 0.0
        end = sweep.start + sweep.span - (sweep.span / sweep.profiles if is_step else 0.0)
        return sweep.start, end

    def _count(self, sweep: Sweep, runs: Sequence[Range]) -> int:
        """Return the number of profiles in the planned range of angles."""
        begin, end = self._range(sweep)
        tolerance = _TOLERANCE_STEPS * sweep.span / sweep.profiles
        return sum(begin - tolerance <= low <= end + tolerance for low, _ in runs)

    def _holes(self, sweep: Sweep, runs: Sequence[Range]) -> list[Range]:
        limit = self._limits.max_gap * sweep.span / sweep.profiles
        return [gap for gap in _gaps(*self._range(sweep), runs) if gap[1] - gap[0] > limit]

    def _numbers(self, sweep: Sweep, laser: str) -> dict[int, float]:
        """Return the views of a planned one, and the radians by which each began later."""
        place = sweep.lasers.index(laser)
        found: dict[int, float] = {}
        for one in (sweep, *self._retakes.get(sweep.number, ())):
            views = sorted(view for view in one.views if view != NOT_MEASURED)
            found[views[place]] = 0.0 if one is sweep else one.turns * _TURN
        return found

    def _header_runs(
        self, sweep: Sweep, laser: str, headers: Mapping[int, ProfileHeader]
    ) -> list[Range]:
        numbers, omitted = self._numbers(sweep, laser), self._omitted(headers)
        angles = (
            header.angle + omitted - numbers[header.view]
            for header in headers.values()
            if header.view in numbers
        )
        return [(angle, angle) for angle in angles]

    def _registered_runs(
        self,
        sweep: Sweep,
        laser: str,
        headers: Mapping[int, ProfileHeader],
        registered: Sequence[Mapping[str, Any]],
    ) -> list[Range] | None:
        """Return the ranges of the registered views; None where the registrar names none."""
        if not any('runs' in view for view in registered):
            return None
        numbers, omitted = self._numbers(sweep, laser), self._omitted(headers)
        return [
            (low + omitted - numbers[view['view']], high + omitted - numbers[view['view']])
            for view in registered
            if view['view'] in numbers
            for low, high in view.get('runs', ())
        ]

    def _omitted(self, headers: Mapping[int, ProfileHeader]) -> float:
        """Return the whole turns, radians, that the triangulator leaves out of the angles."""
        if not headers:
            return 0.0
        first = headers[min(headers)]
        sweep = next((sweep for sweep in self._sweeps.values() if first.view in sweep.views), None)
        if sweep is None:
            return 0.0
        # the first profile is taken at standstill before the lead-in
        return _TURN * round((sweep.begin(self._motion) - first.angle) / _TURN)


def degrees_of(hole: Range) -> list[float]:
    """Return a range of angles in degrees, rounded."""
    return [round(math.degrees(angle), 1) for angle in hole]


def _gaps(begin: float, end: float, runs: Sequence[Range]) -> list[Range]:
    """Return the parts of a range of angles that no run covers, ascending."""
    found = []
    reached = begin
    for low, high in sorted(runs):
        if min(low, end) > reached:
            found.append((reached, min(low, end)))
        reached = max(reached, high)
        if reached >= end:
            return found
    return [*found, (reached, end)] if end > reached else found


def _merged(holes: Sequence[Range]) -> list[Range]:
    """Return the union of ranges, ascending."""
    found: list[Range] = []
    for low, high in sorted(holes):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return found


def _without_turns(hole: Range) -> Range:
    turns = _TURN * math.floor(hole[0] / _TURN + _ROUNDING)
    return max(0.0, hole[0] - turns), hole[1] - turns


def _reason(found: ViewCoverage, limits: CompletenessLimits) -> str:
    """Return why a view is incomplete, '' where it is complete."""
    name = f'view {found.view} (laser {found.laser})'
    if found.missing:
        texts = [f'{low} to {high} degrees' for low, high in map(degrees_of, found.missing)]
        return f'{name}: no profiles from {", ".join(texts)}'
    if found.profiles < limits.min_profiles * found.planned:
        return f'{name}: {found.profiles} of {found.planned} profiles were received'
    if found.stripe < limits.min_stripe:
        return (
            f'{name}: only {100.0 * found.stripe:.1f} % of the profiles have a stripe; check '
            'laser and exposure'
        )
    return ''
