# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far a scan is and how long it will take."""

from collections.abc import Callable

from ivfmc_ros.scan.machine import ENDS
from ivfmc_ros.scan.machine import Stage
from ivfmc_ros.scan.plan import Motion
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep

# What a profile takes in step motion until it has been seen, seconds.
_STEP_S = 0.6
# Registration and mesh, as a share of a profile: seconds for each.
_AFTER_S = 0.05
_STAGES_AFTER = (Stage.REGISTERING, Stage.MESHING, Stage.FINISHING)


class Progress:
    """
    Counts what is done.

    ``profiles_done`` never exceeds what was asked for, though the lead of a sweep gives more.
    """

    def __init__(self, plan: Plan, motion: Motion, clock: Callable[[], float]) -> None:
        self._plan = plan
        self._clock = clock
        self._stage = Stage.IDLE
        self._since = clock()
        self._expected = sum(_seconds(sweep, motion) for sweep in plan.sweeps)
        self.profiles_done = 0
        self.views_done = 0

    def at_stage(self, stage: Stage) -> None:
        """Note a change of stage."""
        if stage is Stage.SCANNING and self._stage is Stage.PREPARING:
            self._since = self._clock()
        self._stage = stage
        if stage in _STAGES_AFTER or stage is Stage.DONE:
            self.views_done = self._plan.views
            self.profiles_done = self._plan.profiles

    def recorded(self, profiles: int) -> None:
        """Note how many profiles are safe on disk."""
        self.profiles_done = min(profiles, self._plan.profiles)

    def in_view(self, view: int) -> None:
        """Note of which view the last profile was."""
        sweeps = [sweep for sweep in self._plan.sweeps if view in sweep.views]
        if sweeps and self._stage is Stage.SCANNING:
            before = self._plan.sweeps[: sweeps[0].number]
            self.views_done = sum(len(sweep.lasers) for sweep in before)

    def eta(self) -> float:
        """Return the seconds until the scan is done, by what is known now."""
        if self._stage in ENDS:
            return 0.0
        total = self._plan.profiles
        after = _AFTER_S * total
        if self._stage in _STAGES_AFTER:
            return after * (len(_STAGES_AFTER) - _STAGES_AFTER.index(self._stage)) / 3
        share = self.profiles_done / total
        spent = self._clock() - self._since
        # what was guessed counts less the more has been seen
        seen = spent / share if share > 0.0 else self._expected
        whole = share * seen + (1.0 - share) * self._expected
        return (1.0 - share) * whole + after


def _seconds(sweep: Sweep, motion: Motion) -> float:
    velocity = sweep.velocity
    if velocity > 0.0:
        way = sweep.span + 2.0 * sweep.lead(motion)
        return motion.seconds(way, velocity) + 1.0
    count = sweep.profiles * len(sweep.lasers)
    return _STEP_S * count
