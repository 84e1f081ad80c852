# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of a scan: views and profiles done, and the estimated time to its end."""

from collections.abc import Callable
from collections.abc import Sequence

from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.state_machine import FINAL_STAGES
from ivfmc_ros.scan.state_machine import Stage

# First estimate for one profile in step motion (move, settle, expose), seconds.
_STEP_S = 0.6
# First estimate for switching and positioning before a continuous sweep, seconds.
_SWEEP_START_S = 1.0
# Estimate for registration and meshing together, seconds per profile.
_PROCESSING_S = 0.05
_PROCESSING_STAGES = (Stage.REGISTERING, Stage.MESHING, Stage.INSPECTING, Stage.FINISHING)


class ScanProgress:
    """
    Counts the recorded profiles and finished views of a scan.

    ``profiles_done`` never exceeds ``profiles_total``, although the lead angle of a continuous
    sweep yields additional profiles.

    profiles_total : planned profiles, and those of the angles that are taken again
    """

    def __init__(self, plan: Plan, motion: MotionLimits, clock: Callable[[], float]) -> None:
        """``clock``: returns seconds; never jumps."""
        self._plan, self._motion = plan, motion
        self._clock = clock
        self._stage = Stage.IDLE
        self._scanning_since_s = clock()
        self._planned_s = sum(_duration_s(sweep, motion) for sweep in plan.sweeps)
        self._repeated_s = 0.0
        self.profiles_total = plan.profiles
        self.profiles_done = 0
        self.views_done = 0

    def set_stage(self, stage: Stage) -> None:
        """Store a change of the scan's stage."""
        if stage is Stage.SCANNING and self._stage is Stage.PREPARING:
            self._scanning_since_s = self._clock()
        self._stage = stage
        if stage in _PROCESSING_STAGES or stage is Stage.DONE:
            self.views_done = self._plan.views
            self.profiles_done = self.profiles_total

    def set_begun(self, sweeps: Sequence[Sweep]) -> None:
        """Store all sweeps that have begun; what they take again is work beside the plan."""
        repeated = [sweep for sweep in sweeps if sweep.retake_of is not None]
        self._repeated_s = sum(_duration_s(sweep, self._motion) for sweep in repeated)
        more = sum(sweep.profiles * len(sweep.lasers) for sweep in repeated)
        self.profiles_total = self._plan.profiles + more

    def set_recorded_profiles(self, profiles: int) -> None:
        """Store the number of profiles that the recorder has written."""
        self.profiles_done = min(profiles, self.profiles_total)

    def set_current_view(self, view: int) -> None:
        """Store the view number of the last profile."""
        sweeps = [sweep for sweep in self._plan.sweeps if view in sweep.views]
        if sweeps and self._stage is Stage.SCANNING:
            finished = self._plan.sweeps[: sweeps[0].number]
            self.views_done = sum(len(sweep.lasers) for sweep in finished)

    def eta_s(self) -> float:
        """Return the estimated seconds until the scan is done."""
        if self._stage in FINAL_STAGES:
            return 0.0
        total = self.profiles_total
        processing = _PROCESSING_S * total
        if self._stage in _PROCESSING_STAGES:
            count = len(_PROCESSING_STAGES)
            return processing * (count - _PROCESSING_STAGES.index(self._stage)) / count
        share = self.profiles_done / total
        elapsed = self._clock() - self._scanning_since_s
        # the extrapolated duration replaces the planned one in proportion to the share done
        expected = self._planned_s + self._repeated_s
        extrapolated = elapsed / share if share > 0.0 else expected
        whole = share * extrapolated + (1.0 - share) * expected
        return (1.0 - share) * whole + processing


def _duration_s(sweep: Sweep, motion: MotionLimits) -> float:
    if sweep.velocity > 0.0:
        distance = sweep.span + 2.0 * sweep.lead_angle(motion)
        return motion.seconds(distance, sweep.velocity) + _SWEEP_START_S
    return _STEP_S * sweep.profiles * len(sweep.lasers)
