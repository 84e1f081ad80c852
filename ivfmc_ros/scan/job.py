# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The course of a scan, told once for every kind of cell.

What it does things with is behind the protocol ``Tools``: the node orchestrator talks to the
graph, a test answers by itself. The job neither knows ROS nor waits in a thread.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from typing import Any
from typing import Protocol

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.scan.machine import Machine
from ivfmc_ros.scan.machine import Stage
from ivfmc_ros.scan.plan import Motion
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.stopwatch import Stopwatch


class Tools(Protocol):
    """What a scan needs done. Whatever cannot be done raises ScanError."""

    async def prepare(self) -> None:
        """Tell everybody which scan it is, and begin to record."""

    async def select(self, sweep: Sweep) -> None:
        """Let profiles belong to the views of this sweep from now on."""

    async def move(self, position: float, velocity: float) -> None:
        """Turn the table to a position (radians) at so many rad/s; return when it stands."""

    async def light(self, laser: str) -> None:
        """Let this laser shine and no other, and return when it does."""

    def dark(self) -> None:
        """Let all lasers go out."""

    async def dark_frame(self) -> None:
        """Return when a picture was taken with all lasers off where the table stands."""

    async def profile_of(self, view: int) -> None:
        """Return when a view has its profile of where the table stands."""

    async def rate(self, sweep: Sweep) -> float:
        """Return how many profiles a second come of the laser that shines, the table standing."""

    async def settled(self, sweep: Sweep) -> None:
        """Return when every picture of the sweep has become a profile."""

    async def resumed(self) -> None:
        """Return when the scan shall go on."""

    async def recorded(self) -> None:
        """Return when every profile is in the bag."""

    async def register(self) -> Mapping[str, Any]:
        """Bring the views together, and return what is said of them."""

    async def build(self) -> Mapping[str, Any]:
        """Make the mesh, and return what is said of it."""

    async def finish(self, outcome: 'Outcome') -> None:
        """Close the bag and write what belongs to the scan."""

    async def halt(self, outcome: 'Outcome') -> None:
        """Stop the table and close the bag, as far as that is possible; never raises."""


@dataclass(kw_only=True)
class Outcome:
    """
    What came of a scan.

    code : OK, or that of the error that ended it
    seconds : of each stage
    """

    code: str = 'OK'
    detail: str = ''
    registration: Mapping[str, Any] = field(default_factory=dict)
    mesh: Mapping[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


async def run_job(machine: Machine, plan: Plan, motion: Motion, tools: Tools) -> Outcome:
    """
    Take a scan from its beginning to its end, whatever that is.

    The lasers are off when it returns, and the machine is DONE, FAILED or CANCELLED.
    """
    outcome = Outcome()
    watch = Stopwatch()
    try:
        await _stages(machine, plan, motion, tools, outcome, watch)
        end = Stage.DONE
    except CancelledError as error:
        outcome.code, outcome.detail, end = error.code, str(error), Stage.CANCELLED
    except ScanError as error:
        outcome.code, outcome.detail, end = error.code, str(error), Stage.FAILED
    except Exception as error:
        outcome.code, outcome.detail = 'INTERNAL', f'{type(error).__name__}: {error}'
        end = Stage.FAILED
    finally:
        tools.dark()
    outcome.seconds = watch.seconds
    if end is not Stage.DONE:
        await tools.halt(outcome)
    machine.advance(end)
    return outcome


async def _stages(
    machine: Machine,
    plan: Plan,
    motion: Motion,
    tools: Tools,
    outcome: Outcome,
    watch: Stopwatch,
) -> None:
    machine.advance(Stage.PREPARING)
    with watch.stage('preparing'):
        await tools.prepare()
    machine.advance(Stage.SCANNING)
    with watch.stage('scanning'):
        for sweep in plan.sweeps:
            await _sweep(sweep, machine, motion, tools)
        tools.dark()
        await tools.recorded()
    machine.advance(Stage.REGISTERING)
    with watch.stage('registering'):
        outcome.registration = await tools.register()
    machine.check()
    machine.advance(Stage.MESHING)
    with watch.stage('meshing'):
        outcome.mesh = await tools.build()
    machine.check()
    machine.advance(Stage.FINISHING)
    outcome.seconds = watch.seconds
    with watch.stage('finishing'):
        await tools.finish(outcome)


async def _sweep(sweep: Sweep, machine: Machine, motion: Motion, tools: Tools) -> None:
    await _wait_while_paused(machine, tools)
    # a laser that still shone would give the new views a profile of the old place
    tools.dark()
    if sweep.velocity > 0.0:
        await _smoothly(sweep, motion, tools)
    else:
        await _stepwise(sweep, machine, motion, tools)


async def _smoothly(sweep: Sweep, motion: Motion, tools: Tools) -> None:
    """Take the profiles in one smooth move, with room for its ramps before and after."""
    lead = sweep.lead(motion)
    begin, end = sweep.start - lead, sweep.start + sweep.span + lead
    await tools.move(begin, motion.velocity)
    await tools.select(sweep)
    await tools.light(sweep.lasers[0])
    velocity = sweep.slowed(await tools.rate(sweep))
    await tools.move(end, velocity)
    await tools.settled(sweep)
    tools.dark()


async def _stepwise(sweep: Sweep, machine: Machine, motion: Motion, tools: Tools) -> None:
    """Stop for every profile; the lasers take turns, the one that shines first."""
    lasers = list(sweep.lasers)
    names = dict(zip(sweep.lasers, sorted(v for v in sweep.views if v >= 0), strict=True))
    for number, angle in enumerate(sweep.angles()):
        await _wait_while_paused(machine, tools)
        await tools.move(angle, motion.velocity)
        if number == 0:
            await tools.select(sweep)
        if sweep.dark:
            tools.dark()
            await tools.dark_frame()
        for laser in lasers:
            await tools.light(laser)
            await tools.profile_of(names[laser])
        # switching takes longer than a picture: go on with the laser that is on
        lasers.reverse()


async def _wait_while_paused(machine: Machine, tools: Tools) -> None:
    machine.check()
    if not machine.pausing:
        return
    tools.dark()
    machine.advance(Stage.PAUSED)
    await tools.resumed()
    machine.advance(Stage.SCANNING)
