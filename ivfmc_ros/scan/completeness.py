# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compares the profiles of a scan with its plan: number, greatest gap in angle, share with a stripe.

Angles are compared in the frame of the planned sweep: table positions without the whole turns that
the triangulator leaves out, and without those that a repeated sweep begins later. A scan that was
interrupted has several parts; the triangulator leaves out other turns in each.
"""

from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
import math
from typing import Any

from ivfmc_ros.scan.angle_ranges import gaps
from ivfmc_ros.scan.angle_ranges import joined
from ivfmc_ros.scan.angle_ranges import merged
from ivfmc_ros.scan.angle_ranges import Range
from ivfmc_ros.scan.angle_ranges import without_turns
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import NOT_MEASURED
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.profile_spacing import greatest_radius
from ivfmc_ros.scan.profile_spacing import greatest_spacing
from ivfmc_ros.scan.profile_spacing import Place
from ivfmc_ros.scan.profile_spacing import wide_ranges
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.scan.view_coverage import incomplete_reason
from ivfmc_ros.scan.view_coverage import ViewCoverage
from ivfmc_ros.storage.matching.image_loss import ImageLoss
from ivfmc_ros.storage.messages.profile_header import ProfileHeader

_TURN = 2.0 * math.pi

# A repeated sweep begins and ends this many steps outside of the missing angles.
_MARGIN_STEPS = 3.0
# Least number of profiles of a repeated sweep and of an interrupted one: the motion model is
# fitted to 12 or more, and views without it are left out (``registration.views.motion_fit``).
_MIN_RETAKEN = 20
# With more holes the nearest ones are taken again in one sweep.
_MAX_HOLES = 3
# Share of the greatest spacing that a denser sweep aims at, as the rate of a camera varies, and
# how many times finer its steps are at most.
_AIM, _MOST_DENSE = 0.8, 10.0
# The table stops within this many steps of a planned angle.
_TOLERANCE_STEPS = 0.1
# Part of a step that is rounding.
_ROUNDING = 1e-4


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
        self._parts = [0]

    def take_over(self, begun: Sequence[Sweep], parts: Sequence[int]) -> None:
        """
        Go on with a scan that was interrupted.

        begun : the sweeps that have begun, as they were executed
        parts : number of the first profile of each part of the scan, 0 first
        """
        for sweep in begun:
            self.begin(sweep)
        known = [view for sweep in begun for view in sweep.views]
        self._next_view = max(self._next_view, 1 + max(known, default=NOT_MEASURED))
        self._parts = sorted(parts)

    @property
    def executed(self) -> list[Sweep]:
        """The sweeps that have begun, repeated ones behind the planned ones."""
        repeated = [one for many in self._retakes.values() for one in many]
        return [*self._sweeps.values(), *repeated]

    def begin(self, sweep: Sweep) -> None:
        """Note that a sweep is executed now."""
        if sweep.retake_of is None:
            self._sweeps[sweep.number] = sweep
        else:
            self._retakes.setdefault(sweep.retake_of, []).append(sweep)

    def retakes(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Sweep]:
        """
        Return the sweeps that take missing angles again, or else those of wide spacing.

        Each is a view of its own, because the table motion is fitted for each view. In step motion
        every profile is waited for, so that none is missing.

        headers : of all profiles of the scan, by number
        """
        return self._missing(sweep, headers) or self._denser(sweep, headers)

    def _missing(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Sweep]:
        """Return the sweeps that take the missing angles of a continuous sweep again."""
        if not sweep.velocity > 0.0:
            return []
        runs = self._header_runs(sweep, sweep.lasers[0], headers)
        holes = self._holes(sweep, runs)
        if self._count(sweep, runs) < self._limits.min_profiles * sweep.profiles:
            holes = [self._range(sweep)]
        return [self._retake(sweep, hole) for hole in joined(holes, _MAX_HOLES)]

    def _denser(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Sweep]:
        """Return the sweeps of finer steps where neighboring profiles are far from each other."""
        limit = self._limits.max_spacing
        # a triggered camera exposes at the same angles again
        if not limit or sweep.trigger_step:
            return []
        places = [self._places(sweep, laser, headers) for laser in sweep.lasers]
        wide = merged([between for of_laser in places for between in wide_ranges(of_laser, limit)])
        finest = sweep.span / sweep.profiles / _MOST_DENSE
        denser = []
        for between in joined(wide, _MAX_HOLES):
            radius = max(greatest_radius(of_laser, between) for of_laser in places)
            denser.append(self._retake(sweep, between, max(_AIM * limit / radius, finest)))
        return denser

    def _places(
        self, sweep: Sweep, laser: str, headers: Mapping[int, ProfileHeader]
    ) -> list[Place]:
        """Return the profiles in the planned range of angles."""
        begin, end = self._range(sweep)
        placed = self._placed(self._numbers(sweep, laser), headers)
        return sorted((angle, h.reach) for h, angle in placed if begin <= angle <= end)

    def remaining(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Sweep]:
        """
        Return the sweeps that take what is missing of a sweep that was interrupted.

        Each is a view of its own. A view with fewer profiles than the motion model needs counts as
        missing.

        headers : of all profiles of the scan, by number
        """
        if sweep.velocity > 0.0:
            begins = {
                max(one.views): one.start - (0.0 if one is sweep else one.turns * _TURN)
                for one in (sweep, *self._retakes.get(sweep.number, ()))
            }
            found = self._angles_by_view(sweep, sweep.lasers[0], headers)
            margin = _TOLERANCE_STEPS * sweep.span / sweep.profiles
            usable = [
                angle
                for view, angles in found.items()
                if sum(angle > begins[view] - margin for angle in angles) >= _MIN_RETAKEN
                for angle in angles
            ]
            holes = self._holes(sweep, [(angle, angle) for angle in usable])
        else:
            holes = self._missing_stops(sweep, headers)
        return [self._retake(sweep, hole) for hole in holes]

    def _missing_stops(self, sweep: Sweep, headers: Mapping[int, ProfileHeader]) -> list[Range]:
        """Return the stops from the first to the last at which a laser has no profile."""
        tolerance = _TOLERANCE_STEPS * sweep.span / sweep.profiles
        missing = []
        for laser in sweep.lasers:
            taken = sorted(low for low, _ in self._header_runs(sweep, laser, headers))
            missing += [
                stop
                for stop in sweep.angles()
                if not any(abs(angle - stop) <= tolerance for angle in taken)
            ]
        return [(min(missing), max(missing))] if missing else []

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
        for sweep in self.executed:
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
        holes, open_ranges = self._holes(sweep, runs), gaps(begin, end, runs)
        kept = self._registered_runs(sweep, laser, headers, registered)
        if kept is not None:
            # what the registrar dropped is missing, too
            holes = sorted({*holes, *self._holes(sweep, kept)})
            open_ranges += gaps(begin, end, kept)
        coverage = ViewCoverage(
            view=min(numbers),
            laser=laser,
            planned=sweep.profiles,
            profiles=self._count(sweep, runs),
            largest_gap=max((high - low for low, high in open_ranges), default=0.0),
            missing=tuple(without_turns(hole) for hole in merged(holes)),
            spacing=greatest_spacing(self._places(sweep, laser, headers)),
            stripe=sum(header.points > 0 for header in own) / len(own) if own else 0.0,
            retaken=tuple(sorted(numbers)[1:]),
        )
        return replace(coverage, why=incomplete_reason(coverage, self._limits))

    def _retake(self, sweep: Sweep, hole: Range, step: float | None = None) -> Sweep:
        """Return the sweep over a range of angles, in steps (radians) as planned or finer."""
        step = step or sweep.span / sweep.profiles
        begin, end = hole[0] - _MARGIN_STEPS * step, hole[1] + _MARGIN_STEPS * step
        is_step = not sweep.velocity > 0.0
        short = 0.0 if is_step else max(0.0, _MIN_RETAKEN * step - (end - begin))
        # the range ends behind the last profile in step motion
        begin, end = begin - 0.5 * short, end + 0.5 * short + (step if is_step else 0.0)
        if end - begin >= sweep.span:
            begin, end = sweep.start, sweep.start + sweep.span
        views = []
        for view in sweep.views:
            views.append(NOT_MEASURED if view < 0 else self._next_view)
            self._next_view += view >= 0
        return replace(
            sweep,
            views=tuple(views),
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
        return [gap for gap in gaps(*self._range(sweep), runs) if gap[1] - gap[0] > limit]

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
        found = self._angles_by_view(sweep, laser, headers)
        return [(angle, angle) for angles in found.values() for angle in angles]

    def _angles_by_view(
        self, sweep: Sweep, laser: str, headers: Mapping[int, ProfileHeader]
    ) -> dict[int, list[float]]:
        """Return the angles of the profiles of each view of a planned one."""
        numbers = self._numbers(sweep, laser)
        found: dict[int, list[float]] = {view: [] for view in numbers}
        for header, angle in self._placed(numbers, headers):
            found[header.view].append(angle)
        return found

    def _placed(
        self, numbers: Mapping[int, float], headers: Mapping[int, ProfileHeader]
    ) -> Iterator[tuple[ProfileHeader, float]]:
        """Yield the profiles of some views with their angles in the frame of the planned one."""
        omitted = self._omitted(headers)
        for header in headers.values():
            if header.view in numbers:
                yield header, header.angle + omitted[header.view] - numbers[header.view]

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
        found = []
        for view in registered:
            if view['view'] in numbers:
                turns = omitted.get(view['view'], 0.0) - numbers[view['view']]
                found += [(low + turns, high + turns) for low, high in view.get('runs', ())]
        return found

    def _omitted(self, headers: Mapping[int, ProfileHeader]) -> dict[int, float]:
        """Return the whole turns, radians, that the triangulator leaves out of each view."""
        begins = {view: one.begin(self._motion) for one in self.executed for view in one.views}
        found: dict[int, float] = {}
        for first, end in pairwise([*self._parts, math.inf]):
            part = {seq: header for seq, header in headers.items() if first <= seq < end}
            if not part:
                continue
            # the first profile is taken at standstill before the lead-in
            start = part[min(part)]
            turns = _TURN * round((begins.get(start.view, start.angle) - start.angle) / _TURN)
            found.update({header.view: turns for header in part.values()})
        return found
