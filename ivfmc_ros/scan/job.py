# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The sequence of a scan: prepare, take every sweep, register, mesh, inspect by recipe, finish.

Every action goes through the protocol ``Tools``: the orchestrator implements it by topics and
services of the graph, a test by plain functions. The sequence imports no ROS and starts no thread.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from typing import Any
from typing import NamedTuple
from typing import Protocol

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.scan.plan import after_position
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.scan.table_verdict import judge_table
from ivfmc_ros.stopwatch import Stopwatch

# A sweep with missing angles is repeated there this often; then the scan is incomplete.
_MAX_RETAKES = 2


class Tools(Protocol):
    """The actions that a scan needs. Every one raises ScanError where it fails."""

    async def prepare(self) -> None:
        """Send the id and the settings of the scan to the nodes, and start the recorder."""

    async def select_views(self, sweep: Sweep) -> None:
        """Set the view numbers of this sweep for the profiles that follow."""

    async def move(self, position: float, velocity: float) -> None:
        """Turn the table to ``position`` (rad) at ``velocity`` (rad/s); return at standstill."""

    async def laser_on(self, laser: str) -> None:
        """Switch this laser on and all others off; return when that is reported."""

    def lasers_off(self) -> None:
        """Command all lasers off; does not wait."""

    async def warm_up(self, sweep: Sweep) -> None:
        """Return when the stripes of the lasers rest, or after the longest time for it."""

    async def take_dark_frame(self) -> None:
        """Return when an image was exposed with all lasers off at the present position."""

    async def check_lasers_off(self) -> None:
        """Return when images were exposed with all lasers off, in which one may still shine."""

    async def wait_for_profile(self, view: int) -> None:
        """Return when a profile of ``view`` at the present position has been received."""

    async def measure_profile_rate(self, sweep: Sweep) -> float:
        """Return the rate of profiles, 1/s, with the present laser at standstill."""

    async def expose(self, seconds: float) -> None:
        """Set the exposure time of the images; return when images have it. 0: leave it."""

    async def trigger_camera(self, *, on: bool) -> None:
        """Start each exposure by the table's trigger, or at the camera's own rate."""

    async def wait_for_sweep_profiles(self, sweep: Sweep) -> None:
        """Return when all images of the sweep have been processed."""

    @property
    def position(self) -> float:
        """Position of the table, radians."""

    def remaining(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take what is missing of a sweep that was interrupted."""

    def retakes(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take the missing angles of ``sweep`` again; none if complete."""

    async def wait_until_resumed(self) -> None:
        """Return when the operator resumes the scan."""

    async def wait_until_recorded(self) -> None:
        """Return when every profile is in the bag."""

    async def register(self) -> Mapping[str, Any]:
        """Register all views; return the registrar's response."""

    def judge(self, outcome: 'Outcome') -> None:
        """Set the code of the outcome where what came is not what the plan asked for."""

    async def build_mesh(self) -> Mapping[str, Any]:
        """Build the mesh and its files; return the mesher's response."""

    @property
    def inspects(self) -> bool:
        """Whether the mesh is judged by a recipe."""

    async def inspect(self, outcome: 'Outcome') -> Mapping[str, Any]:
        """Judge the mesh; return the verdict with the measured features."""

    async def finish(self, outcome: 'Outcome') -> None:
        """Close the bag and write the figures of the scan."""

    async def abort(self, outcome: 'Outcome') -> None:
        """Stop the table and close the bag as far as possible; never raises."""


@dataclass(kw_only=True)
class Outcome:
    """
    The result of a scan.

    code : 'OK', or the code of the error that ended the scan, or of what is wrong with its result
    detail : message of that error
    registration, mesh : responses of registrar and mesher
    inspection : verdict and measured features; empty without a recipe that asks for them
    completeness : what came of the planned views and images
    seconds : duration of each stage
    """

    code: str = 'OK'
    detail: str = ''
    registration: Mapping[str, Any] = field(default_factory=dict)
    mesh: Mapping[str, Any] = field(default_factory=dict)
    inspection: Mapping[str, Any] = field(default_factory=dict)
    completeness: Mapping[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def mark(self, code: str, detail: str) -> None:
        """Note what is wrong with the result of a scan that goes on; the first code is kept."""
        self.code = code if self.code == 'OK' else self.code
        self.detail = '; '.join(text for text in (self.detail, detail) if text)


async def run_job(
    machine: StateMachine,
    plan: Plan,
    motion: MotionLimits,
    tools: Tools,
    begun: Sequence[Sweep] = (),
) -> Outcome:
    """
    Run a scan to its end; errors are returned in the outcome, not raised.

    begun : the planned sweeps that had begun when the scan was interrupted, as they were executed;
        empty for a new scan. Only what is missing of them is taken again

    The lasers are off when it returns, and the machine is DONE, FAILED or CANCELLED.
    """
    outcome = Outcome()
    watch = Stopwatch()
    finished = False
    try:
        await _stages(machine, _Course(plan, motion, begun), tools, outcome, watch)
        finished = True
        # a scan with a wrong result has failed, and keeps its files
        end = Stage.DONE if outcome.code == 'OK' else Stage.FAILED
    except CancelledError as error:
        outcome.code, outcome.detail, end = error.code, str(error), Stage.CANCELLED
    except ScanError as error:
        outcome.code, outcome.detail, end = error.code, str(error), Stage.FAILED
    except Exception as error:
        outcome.code, outcome.detail = 'INTERNAL', f'{type(error).__name__}: {error}'
        end = Stage.FAILED
    finally:
        tools.lasers_off()
    outcome.seconds = watch.seconds
    if not finished:
        machine.refuse_requests()
        await tools.abort(outcome)
    machine.advance(end)
    return outcome


class _Course(NamedTuple):
    """What is to be taken; arguments as those of ``run_job``."""

    plan: Plan
    motion: MotionLimits
    begun: Sequence[Sweep]


async def _stages(
    machine: StateMachine,
    course: _Course,
    tools: Tools,
    outcome: Outcome,
    watch: Stopwatch,
) -> None:
    machine.advance(Stage.PREPARING)
    with watch.stage('preparing'):
        await tools.prepare()
    machine.advance(Stage.SCANNING)
    with watch.stage('scanning'):
        await _sweeps(machine, course, tools)
        tools.lasers_off()
        # a pause that was requested during the last sweep
        await _wait_while_paused(machine, tools)
        await tools.wait_until_recorded()
        await _wait_while_paused(machine, tools)
    machine.advance(Stage.REGISTERING)
    with watch.stage('registering'):
        outcome.registration = await tools.register()
        judge_table(outcome)
        tools.judge(outcome)
    machine.raise_if_cancelled()
    machine.advance(Stage.MESHING)
    with watch.stage('meshing'):
        outcome.mesh = await tools.build_mesh()
    machine.raise_if_cancelled()
    if tools.inspects:
        machine.advance(Stage.INSPECTING)
        with watch.stage('inspecting'):
            outcome.inspection = await tools.inspect(outcome)
        machine.raise_if_cancelled()
    machine.advance(Stage.FINISHING)
    outcome.seconds = watch.seconds
    with watch.stage('finishing'):
        await tools.finish(outcome)


async def _sweeps(machine: StateMachine, course: _Course, tools: Tools) -> None:
    """Take what is missing of the plan, and the angles that are missing then again."""
    plan, motion, begun = course
    position = tools.position if begun else plan.sweeps[0].begin(motion)

    async def take(sweeps: Sequence[Sweep]) -> None:
        nonlocal position
        for sweep in sweeps:
            # a repeated sweep has turned the table further than the plan expects
            following = after_position(sweep, motion, position)
            await _sweep(following, machine, motion, tools)
            position = following.end(motion)

    for sweep in begun:
        await take(tools.remaining(sweep))
        for _ in range(_MAX_RETAKES):
            await take(tools.retakes(sweep))
    numbers = {sweep.number for sweep in begun}
    for planned in plan.sweeps:
        if planned.number in numbers:
            continue
        sweep = after_position(planned, motion, position)
        await take([sweep])
        for _ in range(_MAX_RETAKES):
            await take(tools.retakes(sweep))


async def _sweep(sweep: Sweep, machine: StateMachine, motion: MotionLimits, tools: Tools) -> None:
    await _wait_while_paused(machine, tools)
    # a laser left on would add profiles of the previous position to the new views
    tools.lasers_off()
    await tools.expose(sweep.exposure)
    await tools.warm_up(sweep)
    if sweep.velocity > 0.0:
        await _continuous_sweep(sweep, motion, tools)
    else:
        await _step_sweep(sweep, machine, motion, tools)
    tools.lasers_off()
    await tools.check_lasers_off()


async def _continuous_sweep(sweep: Sweep, motion: MotionLimits, tools: Tools) -> None:
    """Take the profiles in one move; the lead angle before and after holds its ramps."""
    lead = sweep.lead_angle(motion)
    begin, end = sweep.start - lead, sweep.start + sweep.span + lead
    await tools.move(begin, motion.velocity)
    await tools.select_views(sweep)
    await tools.laser_on(sweep.lasers[0])
    velocity = sweep.limited_velocity(await tools.measure_profile_rate(sweep))
    # while the table stands, the camera has to run freely: no trigger comes
    if sweep.trigger_step:
        await tools.trigger_camera(on=True)
    await tools.move(end, velocity)
    if sweep.trigger_step:
        await tools.trigger_camera(on=False)
    await tools.wait_for_sweep_profiles(sweep)


async def _step_sweep(
    sweep: Sweep, machine: StateMachine, motion: MotionLimits, tools: Tools
) -> None:
    """Stop at every angle and take one profile per laser."""
    lasers = list(sweep.lasers)
    views = dict(zip(sweep.lasers, sorted(v for v in sweep.views if v >= 0), strict=True))
    for number, angle in enumerate(sweep.angles()):
        await _wait_while_paused(machine, tools)
        await tools.move(angle, motion.velocity)
        if number == 0:
            await tools.select_views(sweep)
        if sweep.dark:
            tools.lasers_off()
            await tools.take_dark_frame()
        for laser in lasers:
            await tools.laser_on(laser)
            await tools.wait_for_profile(views[laser])
        # switching takes longer than an exposure: the next stop starts with the laser that is on
        lasers.reverse()


async def _wait_while_paused(machine: StateMachine, tools: Tools) -> None:
    machine.raise_if_cancelled()
    if not machine.pause_requested:
        return
    tools.lasers_off()
    machine.advance(Stage.PAUSED)
    await tools.wait_until_resumed()
    machine.advance(Stage.SCANNING)
