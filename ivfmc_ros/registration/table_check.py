# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result of the checks of the table's motion, and the part of it that the trigger shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

from ivfmc_ros.registration.views.motion_fit import SweepMotion

# Codes that stay: the surfaces themselves disagree.
_FAILURES = ('SLIPPED', 'NOT_CONVERGED')


@dataclass(frozen=True, kw_only=True)
class TableCheck:
    """
    Result of the check for lost steps.

    code : 'OK'; 'SLIPPED'; 'NOT_CONVERGED' where the registration found a difference between the
        views that it could not correct; 'TRIGGER_REFUSED' where the pictures of a triggered camera
        cannot be numbered; 'UNCHECKED' where nothing would show a slip
    detail : what was found
    size : radians by which the table lags the reported angle after the slip; NaN if unknown
    view : number of the view in which it slipped; -1 without a slip
    angle_from, angle_to : reported table angles, radians, between which it slipped
    within_view : it slipped while this view was taken, not before it
    compared : share of the surfels that were measured at several times
    round : the part is a solid of revolution about the axis, whose shape a slip does not change
    drift : which light sheets moved while the scan was taken, and by how much; '' for none
    triggers : what triggered pictures lack and which were left out, '' for nothing
    """

    code: str
    detail: str
    size: float = 0.0
    view: int = -1
    angle_from: float = float('nan')
    angle_to: float = float('nan')
    within_view: bool = False
    compared: float = 0.0
    round: bool = False
    triggers: str = ''
    drift: str = ''


def with_triggers(found: TableCheck, motions: Sequence[SweepMotion]) -> TableCheck:
    """
    Return the check of the surfaces with what the triggers of the views show.

    A grid of triggers that moves against the reported positions is SLIPPED: one of both lost
    steps, and the angles are known by neither.
    """
    checks = [(motion.view, motion.trigger) for motion in motions if motion.trigger]
    remarks = [f'view {view}: {one.detail}' for view, one in checks if one.detail and not one.code]
    found = replace(found, triggers='; '.join(remarks))
    failed = [(view, one) for view, one in checks if one.code]
    if not failed:
        return found
    codes = {one.code for _, one in failed}
    texts = [f'view {view}: {one.detail}' for view, one in failed]
    if found.code in _FAILURES:
        return replace(found, detail='; '.join([found.detail, *texts]))
    code = 'SLIPPED' if 'SLIPPED' in codes else codes.pop()
    return replace(found, code=code, detail='; '.join(texts))
