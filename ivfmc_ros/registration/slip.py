# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Check for lost steps: overlap of a sweep with itself and of the lasers, by table angle.

Every view is split into sections of the sweep, and each surfel is compared with the sections that
measured the same place at another time. After a slip the late sections fit the early ones only
when they are rotated about the axis. The check searches the moment and the size that fit best: a
slip is found if it brings surfels together that contradict each other without it. A sweep of more
than a turn measures its beginning again, which shows small slips too (``closure``); where this
does not fit at any rotation, the size of the slip is unknown.
"""

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.agreement import find_disagreement
from ivfmc_ros.registration.agreement import stated_rms
from ivfmc_ros.registration.closure import Closure
from ivfmc_ros.registration.closure import find_closures
from ivfmc_ros.registration.drift import find_drifts
from ivfmc_ros.registration.drift import with_drifts
from ivfmc_ros.registration.sections import compare_at
from ivfmc_ros.registration.sections import RotationFit
from ivfmc_ros.registration.sections import Section
from ivfmc_ros.registration.sections import Sections
from ivfmc_ros.registration.sections import split_sections
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.table_check import TableCheck

# Largest slip whose size is found, radians.
_MAX_SLIP = math.radians(32.0)
# Steps of the searched rotation, radians, and the tolerance of the distance of two surfels,
# meters: a part of 50 mm radius moves by less than the tolerance between two steps.
_COARSE_STEP, _COARSE_TOLERANCE = math.radians(1.0), 6e-4
_COARSE_STRIDE = 3
_FINE_STEP, _FINE_TOLERANCE = math.radians(0.1), 1.2e-4
# The fine search covers slips up to this size, and this range about the result of the coarse one.
_FINE_RANGE, _FINE_MARGIN = math.radians(1.5), math.radians(1.0)
# A slip explains why surfels across its boundary do not fit: of what they lack, at most this share
# is left after it, by its size, radians. Errors of the calibration explain less. Chosen on a box,
# a tube, a wall of 2 mm and the demo part, 80 to 200 profiles a turn, begun anywhere: slips of 5
# to 14 degrees leave up to 0.80, of 2 degrees 0.67 (a few 0.85). Axis and lasers off by 0.02 to
# 0.2 mm and 0.01 to 0.1 degrees look like up to a degree and leave 0.55 and more, like 1 to 3
# degrees and leave 0.78, like larger ones and leave 0.87.
_MAX_LEFT = ((math.radians(0.95), 0.45), (math.radians(3.0), 0.7), (math.inf, 0.8))
# A rotation that leaves more is chance, and no doubt.
_MAX_LEFT_OF_DOUBT = 0.9
# A slip that moves the surface by less, meters rms, or by less than the stated error of the
# calibration, cannot be told from one: 0.03 mm look like 0.3 degrees on a tube 6 mm off the axis.
_MIN_SHIFT = 4e-5
# A slip must bring so many surfels together: this share of those that it moves along their normal,
# at least the first number, and at most this share of a view. Chosen on the box and the plate of
# test_slip.py, and on good scans of the demo part that begin anywhere, whose gain is up to 16.
_MIN_GAIN, _MIN_GAIN_SHARE, _MAX_GAIN_SHARE = 20.0, 0.06, 0.012
# A surfel shows a rotation if its normal passes the axis at this distance, meters.
_MIN_ARM = 1e-3
# A smaller slip is within the periodic error of a table and the error of a calibration, radians.
_MIN_SLIP = math.radians(0.25)
# A boundary is checked if a slip of this size, radians, would part so many surfels.
_TEST_SLIP, _MIN_LOSS = math.radians(1.0), 10.0
# Profiles farther apart on average, radians, give surfels whose error looks like a slip: the demo
# part with 40 profiles a turn, and good sweeps of a live cell with 5.0 and 5.4 degrees, which
# looked like -3.5 and +1.4 degrees.
_MAX_STEP = math.radians(4.6)
# A scan of which a slip at a larger share of the boundaries would not show is unchecked: with
# several lasers, and with one, which sees little but top faces twice (the wall of 2 mm).
_MAX_UNCHECKED, _MAX_UNCHECKED_OF_ONE = 0.5, 0.1
# A part is round if a rotation by this angle, radians, parts a smaller share of its surfels.
_ROUND_TEST, _ROUND_SHARE = math.radians(3.0), 0.01
# Of the surfels that were measured a whole turn later again, so many must fit, of at least so many
# surfels: of all, and of those that a rotation moves. Top and round faces fit after every slip:
# 63 % of the surfels of a bracket that slipped by 20 degrees; of its others 4 % fitted.
# Of the others, 44 % fit in good scans of the demo part and two boxes, profiles 4.3 degrees apart.
_MIN_CLOSURE, _MIN_CLOSURE_SURFELS = 0.5, 30
_MIN_MOVED_CLOSURE, _MIN_MOVED_SURFELS = 0.25, 20


def check_registration(
    views: Sequence[View],
    poses: Poses,
    verdicts: Sequence[Verdict],
    cell: Cell | None = None,
) -> TableCheck:
    """
    Return whether the registered views agree: the check for lost steps, and the verdicts.

    cell : views may disagree by what its calibration states; None for an exact one
    """
    unmoved = split_sections(views)
    found = _with_drift(_check_table(unmoved, poses, cell), unmoved, cell)
    failed = [verdict for verdict in verdicts if verdict.failed]
    if found.code in ('SLIPPED', 'NOT_CONVERGED') or not failed:
        return found
    kept = ', '.join(f'view {verdict.view}: {verdict.why}' for verdict in failed)
    return replace(
        found,
        code='NOT_CONVERGED',
        detail=f'the registration found no poses at which the views agree ({kept}); check that '
        'the part stands firmly and the calibration is valid, then scan again',
    )


def _with_drift(found: TableCheck, unmoved: Sections | None, cell: Cell | None) -> TableCheck:
    """Return the check with the light sheets that moved, seen at the table's own poses."""
    if cell is None or unmoved is None or _is_too_coarse(unmoved):
        return found
    return with_drifts(found, find_drifts(unmoved, cell), cell)


def _is_too_coarse(sections: Sections) -> bool:
    return any(step > _MAX_STEP for step in sections.steps)


def _check_table(unmoved: Sections | None, poses: Poses, cell: Cell | None) -> TableCheck:
    """
    Check whether the table lost steps in or between the sweeps.

    unmoved : sections at the poses of the table; None where no view has a surface
    poses : corrections that the registration applied
    """
    rms = stated_rms(cell)
    if unmoved is None or len(unmoved.items) < 2:
        return TableCheck(code='UNCHECKED', detail='no view has a surface')
    if _is_too_coarse(unmoved):
        detail = (
            'lost steps of the table would not show: the profiles are more than '
            f'{math.degrees(_MAX_STEP):.1f} degrees apart; take more profiles'
        )
        return TableCheck(code='UNCHECKED', detail=detail)
    found = _Check(unmoved.placed(poses), rms).run()
    if (found.code == 'SLIPPED' and not math.isfinite(found.size)) or _is_identity(poses):
        return found
    # the registration shares a slip between the views: measured again at the table's poses
    again = _Check(unmoved, rms).run()
    # it corrects one between two views, but not one within a view
    is_uncorrected = found.code == 'SLIPPED' or again.within_view
    return again if again.code == 'SLIPPED' and is_uncorrected else found


def _is_identity(poses: Poses) -> bool:
    return bool(np.allclose(poses.turntable_from_view, np.eye(4), atol=1e-12))


class _Check:
    """
    Search for the slip that fits best.

    calibration_rms : meters, as the cell states it
    """

    def __init__(self, sections: Sections, calibration_rms: float) -> None:
        self._sections = sections
        self._calibration_rms = calibration_rms
        self._now = compare_at(sections, np.zeros(1), _FINE_TOLERANCE)
        self._boundaries = np.arange(1, len(sections.items))

    def run(self) -> TableCheck:
        """Return what the overlaps tell about the table."""
        compared = float((self._now.fit[:, 0] > 0).mean()) if len(self._now.own) else 0.0
        found = TableCheck(code='OK', detail='', compared=compared, round=self._is_round())
        if found.round and compared > 0:
            return self._judge_round(found)
        row, size, gain = self._best()
        is_significant = gain >= self._least_gain(row) and abs(size) >= _MIN_SLIP
        is_large = self._shift(row, size) >= max(_MIN_SHIFT, self._calibration_rms)
        left = self._left(row, gain)
        if is_significant and is_large and left <= _max_left(size):
            return self._slipped(found, size, self._between(size, gain))
        closures = find_closures(self._sections)
        lost = self._failed_closure()
        if lost is not None:
            return self._slipped(found, float('nan'), lost)
        for closure in closures:
            if closure.is_slip:
                return self._slipped(found, closure.size, (closure.before, closure.after))
        is_doubtful = is_significant and left <= _MAX_LEFT_OF_DOUBT
        is_refuted = not self._hidden_from(closures)[row]
        code, detail = self._doubt(size if is_doubtful and not is_refuted else 0.0, closures)
        return replace(found, code=code, detail=detail)

    def _judge_round(self, found: TableCheck) -> TableCheck:
        """Return what is known of a part that a rotation does not change."""
        disagreement = find_disagreement(self._sections, self._calibration_rms)
        if disagreement:
            return replace(found, code='NOT_CONVERGED', detail=disagreement)
        # every profile of a table that stands is the same, too
        detail = (
            'the part is round about the axis, so that lost steps neither show nor change its '
            'shape; if it is not round, the table did not turn'
        )
        return replace(found, code='UNCHECKED', detail=detail)

    def _doubt(self, size: float, closures: Sequence[Closure]) -> tuple[str, str]:
        """
        Return code and detail where no slip explains what the views show.

        size : radians, of a slip that explains a part of it; 0 for none
        """
        disagreement = find_disagreement(self._sections, self._calibration_rms)
        if disagreement:
            return 'NOT_CONVERGED', disagreement
        if size:
            return 'UNCHECKED', (
                'the views differ by more than their noise: a slip of '
                f'{math.degrees(size):+.2f} degrees explains a part of it, an error of the '
                'calibration as well; check the laser planes and the axis'
            )
        is_one = len(set(self._sections.lasers)) == 1
        if self._unchecked(closures) > (_MAX_UNCHECKED_OF_ONE if is_one else _MAX_UNCHECKED):
            return 'UNCHECKED', (
                'lost steps of the table would not show: no surface that shows a rotation was '
                'measured at two times; use two lasers, or a sweep of more than a turn (closure)'
            )
        return 'OK', ''

    def _crossing(self, row: int) -> Bools:
        """Return which surfels that a rotation moves meet the other side of a boundary, (n,)."""
        boundary, now = self._boundaries[row], self._now
        other = now.other[:, 0]
        crossing = (other >= 0) & ((now.own >= boundary) != (other >= boundary))
        return np.asarray(crossing & (self._sections.arms > _MIN_ARM))

    def _left(self, row: int, gain: float) -> float:
        """Return the share that a slip leaves of what surfels across its boundary lack to fit."""
        lacking = float((1.0 - self._now.fit[self._crossing(row), 0]).sum())
        return (lacking - gain) / lacking if lacking > 0.0 else 0.0

    def _shift(self, row: int, size: float) -> float:
        """Return by how much a slip moves the surfels across its boundary, meters rms."""
        arms = self._sections.arms[self._crossing(row)]
        return abs(size) * float(np.sqrt(np.mean(arms**2))) if len(arms) else 0.0

    def _least_gain(self, row: int) -> float:
        """Return the gain, in surfels, above which a slip at a boundary is significant."""
        moved = np.count_nonzero(self._crossing(row))
        most = max(_MIN_GAIN, _MAX_GAIN_SHARE * self._sections.largest_view)
        return float(np.clip(_MIN_GAIN_SHARE * moved, _MIN_GAIN, most))

    def _best(self) -> tuple[int, float, float]:
        """Return boundary, size (radians) and gain of the slip that fits best."""
        coarse = _grid(_MAX_SLIP, _COARSE_STEP)
        gains = self._gains(coarse, _COARSE_TOLERANCE, _COARSE_STRIDE)
        size = float(coarse[gains.max(axis=0).argmax()])
        around = _grid(_FINE_RANGE, _FINE_STEP)
        if abs(size) > _COARSE_STEP:
            near = abs(size) + _grid(_FINE_MARGIN, _FINE_STEP)
            around = np.concatenate([around, near, -near])
        fine = np.unique(np.round(around, 6))
        self._fine, self._fine_gains = fine, self._gains(fine, _FINE_TOLERANCE)
        row, column = np.unravel_index(self._fine_gains.argmax(), self._fine_gains.shape)
        return int(row), float(fine[column]), float(self._fine_gains[row, column])

    def _gains(self, sizes: Floats, tolerance: float, stride: int = 1) -> Floats:
        """
        Return the gain of each slip, in surfels that fit, (boundaries, sizes).

        sizes : radians, ascending and symmetric about 0

        Only surfels count that meet the other side without the slip, and that it moves along their
        normal: covering more is no evidence, and those of top and round faces slide to an edge.
        """
        now = compare_at(self._sections, np.zeros(1), tolerance, stride)
        shows = self._sections.arms[::stride] > _MIN_ARM
        # late surfels rotate by the slip, early ones by its inverse
        turned = compare_at(self._sections, sizes, tolerance, stride)
        back = replace(turned, other=turned.other[:, ::-1], fit=turned.fit[:, ::-1])
        gains = np.zeros((len(self._boundaries), len(sizes)))
        for row, boundary in enumerate(self._boundaries.tolist()):
            for moved, late in ((turned, True), (back, False)):
                gains[row] += _gain(now, moved, boundary, late, shows)
        return gains

    def _between(self, size: float, gain: float) -> tuple[Section, Section]:
        """Return the sections before and after the range of boundaries that fit equally well."""
        column = int(np.argmin(np.abs(self._fine - size)))
        likely = np.flatnonzero(self._fine_gains[:, column] >= 0.97 * gain)
        items = self._sections.items
        first = int(self._fine_gains[:, column].argmax())
        same = likely[
            [
                items[self._boundaries[k]].view == items[self._boundaries[first]].view
                for k in likely
            ]
        ]
        return items[self._boundaries[same[0]] - 1], items[self._boundaries[same[-1]]]

    def _failed_closure(self) -> tuple[Section, Section] | None:
        """Return first and last section of a sweep whose end does not fit its beginning."""
        for view in sorted({item.view for item in self._sections.items}):
            twins = np.isin(self._now.own, self._sections.repeated(view))
            moved = twins & (self._sections.arms > _MIN_ARM)
            for mine, surfels, share in (
                (twins, _MIN_CLOSURE_SURFELS, _MIN_CLOSURE),
                (moved, _MIN_MOVED_SURFELS, _MIN_MOVED_CLOSURE),
            ):
                if np.count_nonzero(mine) < surfels:
                    continue
                if np.mean(self._now.fit[mine, 0] > 0) < share:
                    items = [item for item in self._sections.items if item.view == view]
                    return items[0], items[-1]
        return None

    def _unchecked(self, closures: Sequence[Closure]) -> float:
        """Return the share of the boundaries at which a slip would not show."""
        losses = -self._gains(np.array([-_TEST_SLIP, _TEST_SLIP]), _FINE_TOLERANCE).max(axis=1)
        hidden = (losses < _MIN_LOSS) & self._hidden_from(closures)
        return float(np.mean(hidden)) if len(hidden) else 1.0

    def _hidden_from(self, closures: Sequence[Closure]) -> Bools:
        """Return at which boundaries no closure would show a slip, (boundaries,) bool."""
        seqs = np.array([self._sections.items[k].seq for k in self._boundaries.tolist()])
        hidden = np.ones(len(seqs), dtype=bool)
        for closure in closures:
            if closure.is_informative:
                hidden &= (seqs <= closure.before.seq) | (seqs > closure.after.seq)
        return hidden

    def _is_round(self) -> bool:
        sides = compare_at(
            self._sections, np.array([0.0, -_ROUND_TEST, _ROUND_TEST]), _FINE_TOLERANCE, own=True
        )
        still, *turned = (sides.fit > 0).sum(axis=0)
        return bool(min(turned) >= (1.0 - _ROUND_SHARE) * still)

    def _slipped(
        self, found: TableCheck, size: float, between: tuple[Section, Section]
    ) -> TableCheck:
        before, after = between
        number = self._sections.numbers[after.view]
        begin = before.angle_from if before.view == after.view else after.angle_from
        where = (
            f'view {number}, at table angles of {math.degrees(begin):.0f} to '
            f'{math.degrees(after.angle_to):.0f} degrees'
        )
        how = (
            f'by {math.degrees(size):+.2f} degrees'
            if math.isfinite(size)
            else 'by an unknown angle: the end of the sweep does not fit its beginning'
        )
        return replace(
            found,
            code='SLIPPED',
            detail=f'the table or the part slipped {how} ({where}); check motor current, '
            'acceleration, coupling, clamping and the steps per turn, then scan again',
            size=size,
            view=number,
            angle_from=begin,
            angle_to=after.angle_to,
            within_view=before.view == after.view,
        )


def _max_left(size: float) -> float:
    """Return the share that a slip of ``size`` radians may leave."""
    return next(left for limit, left in _MAX_LEFT if abs(size) < limit)


def _grid(extent: float, step: float) -> Floats:
    count = round(extent / step)
    return np.asarray(step * np.arange(-count, count + 1))


def _gain(now: RotationFit, moved: RotationFit, boundary: int, late: bool, shows: Bools) -> Floats:
    """
    Return (sizes,) how many more surfels of one side of a boundary fit when they are moved.

    shows : (n,) which surfels show a rotation
    """
    mine = ((now.own >= boundary) == late) & shows
    crossing = mine & (now.other[:, 0] >= 0) & ((now.other[:, 0] >= boundary) != late)
    if not crossing.any():
        return np.zeros(moved.fit.shape[1])
    other, fit = moved.other[crossing], moved.fit[crossing]
    across = (other >= 0) & ((other >= boundary) != late)
    return np.asarray(np.where(across, fit, 0.0).sum(axis=0) - now.fit[crossing, 0].sum())
