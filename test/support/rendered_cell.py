# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A scan of a rendered part without ROS and without waiting, with one fault in it.

The sequence is ``scan.job.run_job`` with the checks of the orchestrator. Table, lasers and camera
publish stamped messages on a simulated clock; the classes that the nodes use match them, watch the
clocks, and register the views. The table turns at constant speed, and the camera exposes where the
true angle is one of those that were rendered.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import asdict
from dataclasses import dataclass
import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from ivfmc_ros import pipeline
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.processing import worker_jobs
from ivfmc_ros.nodes.scanning.scan_checks import ScanChecks
from ivfmc_ros.registration.views.assemble import angle_runs
from ivfmc_ros.scan.clock_monitor import ClockMonitor
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate

# Periods of the messages of the bench cell, seconds: joint_rate of turntable, laser_states, and
# the check of the orchestrator's own clock.
_JOINT_S, _LASER_S, _CHECK_S = 1.0 / 60.0, 0.1, 0.1
# Latencies of state messages and of images, seconds, least and greatest.
_STATE_LATENCY_S, _IMAGE_LATENCY_S = (0.001, 0.01), (0.03, 0.06)
# ``exposure`` and ``patience`` of the bench cell's triangulator, seconds.
_EXPOSURE_S, _PATIENCE_S = 0.005, 2.0
# Seconds that the table stands after each move.
_REST_S = 0.5
# Stamp at the simulated second 0, nanoseconds.
_EPOCH_NS = 1_790_000_000_000_000_000
LASERS = ('left', 'right')


@dataclass(frozen=True, kw_only=True)
class Fault:
    """
    What happens at the second ``at`` of the beam's time, counted over all sweeps.

    slip : radians by which the table lags its reported position from then on
    stall : seconds in which the camera takes no image
    jump : seconds by which a clock is set
    clock : whose clock: 'camera', 'table' (each on a computer of its own), or 'all'
    """

    at: float = math.inf
    slip: float = 0.0
    stall: float = 0.0
    jump: float = 0.0
    clock: str = 'all'


class RenderedCell:
    """
    Implements ``scan.job.Tools``.

    stripes : of each laser, at equal steps of a turn
    seed : of the latencies
    registered : views and poses after ``register``
    """

    def __init__(
        self,
        cell: Cell,
        stripes: Sequence[Sequence[Stripe]],
        plan: Plan,
        motion: MotionLimits,
        fault: Fault,
        seed: int = 0,
    ) -> None:
        self._cell, self._stripes, self._motion, self._fault = cell, stripes, motion, fault
        self._rng = np.random.default_rng(seed)
        # the profiles that the sweeps plan are the rendered ones
        self._step = 2.0 * math.pi / len(stripes[0])
        self._now_s = self._beam_s = 0.0
        # when the fault began, in the seconds of the cell
        self._begun_s = math.inf
        # the table stands where the plan begins
        self._position = plan.sweeps[0].begin(motion)
        self._laser: int | None = None
        self._profiles: list[Profile] = []
        self._clocks = ClockMonitor(lambda: self._now_s, lambda: self._wall_s('orchestrator'))
        self._matcher = FrameMatcher(LASERS, MatchSettings(exposure=_EXPOSURE_S))
        # nothing cuts the part, no stripe moves after a stop, the focus stays
        watch = SimpleNamespace(**dict.fromkeys(('part_cut', 'unsettled', 'focus'), lambda _: ''))
        self._link = SimpleNamespace(headers={}, info_stamps_ns=[], diagnostics=watch)
        self._checks = ScanChecks(self._link, plan, motion, CompletenessLimits(), '')  # type: ignore[arg-type]
        self.registered: worker_jobs.RegisteredViews | None = None

    # -- the messages

    def _wall_s(self, clock: str) -> float:
        """Return what a clock shows now, seconds since the epoch of the simulation."""
        jumped = self._now_s >= self._begun_s
        same = self._fault.clock in ('all', clock)
        return self._now_s + (self._fault.jump if jumped and same else 0.0)

    def _stamp_ns(self, clock: str) -> int:
        return _EPOCH_NS + round(self._wall_s(clock) * 1e9)

    def _turn(self, target: float, velocity: float) -> None:
        """Move the table, and handle all messages of that time in the order of their arrival."""
        begin_s, start = self._now_s, self._position
        seconds = abs(target - start) / velocity
        end_s = begin_s + seconds + _REST_S

        def position_at(time_s: float) -> float:
            return start + (target - start) * min(1.0, (time_s - begin_s) / max(seconds, 1e-9))

        self._begin_fault(begin_s, seconds)
        sent: list[tuple[float, int, Any]] = []
        for time_s in np.arange(begin_s, end_s, _JOINT_S):
            moving = velocity if time_s < begin_s + seconds else 0.0
            sent.append((time_s, 0, (position_at(time_s), moving)))
        sent += [(time_s, 1, self._laser) for time_s in np.arange(begin_s, end_s, _LASER_S)]
        sent += [(time_s, 2, None) for time_s in np.arange(begin_s, end_s, _CHECK_S)]
        sent += [(time_s, 3, at) for time_s, at in self._exposures(begin_s, seconds, target)]
        arrivals = []
        for time_s, kind, value in sent:
            self._now_s = time_s
            stamp_ns = self._stamp_ns('camera' if kind == 3 else 'table')
            latency = _IMAGE_LATENCY_S if kind == 3 else _STATE_LATENCY_S
            arrives_s = time_s + (self._rng.uniform(*latency) if kind != 2 else 0.0)
            arrivals.append((arrives_s, kind, stamp_ns, value))
        for arrives_s, kind, stamp_ns, value in sorted(arrivals, key=lambda one: one[0]):
            self._now_s = arrives_s
            self._receive(kind, stamp_ns, value)
        self._position, self._now_s = target, end_s + _IMAGE_LATENCY_S[1]
        self._clocks.require_no_jump()

    def _begin_fault(self, begin_s: float, seconds: float) -> None:
        """Find out whether the fault begins in this move; only the time with beam counts."""
        if self._laser is None:
            return
        rest_s = self._fault.at - self._beam_s
        self._beam_s += seconds
        if 0.0 <= rest_s < seconds:
            self._begun_s = begin_s + rest_s

    def _exposures(
        self, begin_s: float, seconds: float, target: float
    ) -> list[tuple[float, tuple[int, int]]]:
        """Return time and (laser, index of the stripe) of each image with the beam on."""
        if self._laser is None or seconds <= 0.0:
            return []
        speed = (target - self._position) / seconds
        stall = self._begun_s, self._begun_s + self._fault.stall
        found = []
        for lag, after_s, before_s in (
            (0.0, -math.inf, self._begun_s),
            (self._fault.slip, self._begun_s, math.inf),
        ):
            low, high = sorted((self._position - lag, target - lag))
            first, last = math.ceil(low / self._step), math.floor(high / self._step)
            for index in range(first, last + 1):
                time_s = begin_s + (index * self._step + lag - self._position) / speed
                stalled = stall[0] <= time_s < stall[1]
                if after_s <= time_s < before_s and not stalled:
                    found.append((time_s, (self._laser, index % len(self._stripes[0]))))
        return found

    def _receive(self, kind: int, stamp_ns: int, value: Any) -> None:
        if kind == 0:
            self._clocks.add('joint_states', stamp_ns)
            self._matcher.add_table_position(stamp_ns, *value, now_s=self._now_s)
        elif kind == 1:
            states = {name: float(index == value) for index, name in enumerate(LASERS)}
            self._matcher.add_laser_states(stamp_ns, states, self._now_s)
        elif kind == 2:
            self._clocks.check_own_clock()
        else:
            self._clocks.add('camera_info', stamp_ns)
            self._link.info_stamps_ns.append(stamp_ns)
            self._matcher.add_image(stamp_ns, value, self._now_s)
        self._take_profiles(self._now_s)

    def _take_profiles(self, now_s: float) -> None:
        for match in self._matcher.pop_matches(now_s, _PATIENCE_S):
            if match.reason:
                continue
            laser, index = match.payload
            frame = Frame(
                image=np.zeros((1, 1), dtype=np.uint8),
                stamp_ns=match.stamp_ns,
                angle=match.angle,
                speed=match.speed,
                laser=match.laser,
                view=match.view,
                seq=len(self._profiles),
            )
            profile = triangulate(self._cell, frame, self._stripes[laser][index])
            self._profiles.append(profile)
            self._link.headers[profile.seq] = ProfileHeader(
                seq=profile.seq,
                view=profile.view,
                laser=profile.laser,
                angle=profile.angle,
                points=len(profile),
                stamp_ns=profile.stamp_ns,
                speed=profile.speed,
            )

    # -- scan.job.Tools

    async def prepare(self) -> None:
        """Let the clocks become known, as the orchestrator does from its start on."""
        self._turn(self._position, 1.0)

    async def select_views(self, sweep: Sweep) -> None:
        """Set the view numbers of this sweep for the profiles that follow."""
        self._checks.begin(sweep)
        self._matcher.settings = MatchSettings(exposure=_EXPOSURE_S, views=tuple(sweep.views))

    async def move(self, position: float, velocity: float) -> None:
        """Turn the table to ``position`` (rad) at ``velocity`` (rad/s)."""
        self._turn(position, velocity)

    async def laser_on(self, laser: str) -> None:
        """Switch this laser on and all others off."""
        self._laser = LASERS.index(laser)
        self._turn(self._position, 1.0)

    def lasers_off(self) -> None:
        """Switch all lasers off."""
        self._laser = None

    async def expose(self, seconds: float) -> None:
        """All images have one exposure time."""

    async def warm_up(self, sweep: Sweep) -> None:
        """Lasers are warm."""

    async def measure_profile_rate(self, sweep: Sweep) -> float:
        """Return the planned rate of profiles, 1/s."""
        return self._motion.profile_rate

    async def check_lasers_off(self) -> None:
        """Nothing shines that is off."""

    async def wait_for_sweep_profiles(self, sweep: Sweep) -> None:
        """Match the images that still wait."""
        self._take_profiles(math.inf)

    @property
    def position(self) -> float:
        """Position of the table, radians."""
        return self._position

    def remaining(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take what is missing of an interrupted one."""
        return self._checks.remaining(sweep)

    def retakes(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take the missing angles of ``sweep`` again."""
        return self._checks.retakes(sweep)

    async def wait_until_recorded(self) -> None:
        """Nothing is recorded."""

    async def register(self) -> Mapping[str, Any]:
        """Register all views as the registrar does."""
        made = worker_jobs.register(self._cell, self._profiles, pipeline.Settings())
        self.registered = made
        return {
            'views': [{'view': view.number, 'runs': angle_runs(view)} for view in made.views],
            'table': asdict(made.table),
        }

    def judge(self, outcome: Outcome) -> None:
        """Set the code of the outcome where what came is not what the plan asked for."""
        self._checks.judge(outcome)

    async def build_mesh(self) -> Mapping[str, Any]:
        """Nothing is meshed: the points are compared with the part."""
        return {}

    @property
    def inspects(self) -> bool:
        """There is no recipe."""
        return False

    async def inspect(self, outcome: Outcome) -> Mapping[str, Any]:
        """There is no recipe."""
        raise NotImplementedError

    async def finish(self, outcome: Outcome) -> None:
        """Nothing is written."""

    async def abort(self, outcome: Outcome) -> None:
        """Nothing moves."""
