# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Table angles of a camera that the table triggers: picture n is taken at phase + n * trigger_step.

The motion controller, or a divider on the step line of the motor, gives a pulse after each
``trigger_step`` of travel, and the camera exposes on the pulse. The fit of the motion
(``motion_fit``) tells to which step a picture belongs; its angle is then that of the step, in
which there is no clock and no delay of a report. The phase is one constant for all sweeps in one
direction. Where the step of a picture is not certain, the view keeps its fitted angles, and the
check of its trigger has the code and the reason.
"""

from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.model import Profile
from ivfmc_ros.registration.views.motion_fit import SweepMotion
from ivfmc_ros.registration.views.motion_fit import turned_to
from ivfmc_ros.registration.views.trigger_grid import share_phases
from ivfmc_ros.registration.views.trigger_grid import TriggerGrid

# Seconds between independent reports of the position: at 5 Hz, the slowest of the serial boards.
_REPORT_S = 0.2


def number_profiles(
    profiles: Iterable[Profile], motions: Sequence[SweepMotion], step: float
) -> tuple[list[Profile], list[SweepMotion]]:
    """
    Replace the fitted angles of triggered pictures by those of the trigger's steps.

    Points are rotated about the axis by the change of their angle. Views at whose pictures the
    table stood are unchanged.

    profiles, motions : as ``motion_fit.refit`` returns them
    step : trigger_step of the cell, radians; 0 for a camera that the table does not trigger
    returns : the profiles that are kept, and the motions with their ``trigger``
    """
    profiles = list(profiles)
    if not step:
        return profiles, list(motions)
    of_view = {motion.view: [p for p in profiles if p.view == motion.view] for motion in motions}
    grids = {
        motion.view: _grid_of(of_view[motion.view], motion, step)
        for motion in motions
        if (motion.speed or motion.why) and of_view[motion.view]
    }
    share_phases([grid for grid in grids.values() if not grid.code])
    found: list[Profile] = []
    checked = []
    for motion in motions:
        grid = grids.get(motion.view)
        if grid is None:
            found += of_view[motion.view]
            checked.append(motion)
            continue
        kept, check = grid.numbered()
        if check.code:
            found += of_view[motion.view]
        else:
            taken = [of_view[motion.view][k] for k in kept.tolist()]
            angles = grid.angles[kept]
            found += [turned_to(p, angle) for p, angle in zip(taken, angles, strict=True)]
        checked.append(replace(motion, trigger=check))
    return found, checked


def _grid_of(profiles: Sequence[Profile], motion: SweepMotion, step: float) -> TriggerGrid:
    angles = np.array([p.angle for p in profiles])
    if motion.why:
        grid = TriggerGrid(angles, step)
        grid.refuse('the table did not turn at a constant speed')
        return grid
    seconds = 1e-9 * (profiles[-1].stamp_ns - profiles[0].stamp_ns)
    reports = max(1.0, seconds / _REPORT_S)
    return TriggerGrid(
        angles,
        step,
        direction=1 if motion.speed > 0 else -1,
        # end to end, a slope that is fitted to n positions has sqrt(12 / n) of their deviation
        uncertainty=abs(motion.speed) * motion.jitter * math.sqrt(12.0 / reports),
    )
