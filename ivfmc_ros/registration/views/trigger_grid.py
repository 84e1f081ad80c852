# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Grid of a trigger in the fitted table angles of a sweep: the step that each picture belongs to.

Picture n of a triggered camera is exposed at phase + n * trigger_step. The fitted angles determine
n, and the phase is found in windows along the sweep (circular statistics: Mardia and Jupp 2000):
windows off any grid, a phase that drifts, and a scatter that is large against the step are
refused, because a number would not be certain. A slip by a whole number of steps looks like
dropped triggers here; the registration finds it (``registration.slip``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Pictures by which the phase is found locally. With a fifth of the triggers doubled and spurious
# ones a window of 15 keeps a resultant above 0.6.
_WINDOW = 15
# Least resultant (mean of unit vectors, 1 on a grid) of a window that lies on a grid. Of pictures
# at random angles one window in forty exceeds it: exp(-15 * 0.5^2).
_MIN_RESULTANT = 0.5
# Greatest share of the windows that may be off any grid.
_MAX_OFF_WINDOWS = 0.1
# Greatest robust scatter about the grid, in steps: half a step, where the number of a picture
# changes, is 6 of its standard deviations away.
_MAX_SCATTER = 0.08
# A picture is off the grid by more than so many standard deviations, within these limits in steps.
_SIGMAS, _MIN_TOLERANCE, _MAX_TOLERANCE = 5.0, 0.03, 0.25
# The phase may change within a sweep, or differ between sweeps, by so many standard deviations of
# the fitted angles, within these limits in steps; more is another grid. An even drift, which keeps
# the numbers certain, has no upper limit.
_DRIFT_SIGMAS, _MIN_DRIFT, _MAX_DRIFT = 4.0, 0.08, 0.25
# A drift of the phase is even if a line leaves this share of it at most. One by more steps in a
# sweep is another spacing of the pictures, a smaller one are lost steps.
_MAX_BENT, _MAX_LOST = 0.25, 3.0
# Pictures at the ends of a sweep of which some may be taken in a ramp that the motion fit did not
# see: the fitted angle runs away from the true one there, past the middle between two steps.
_ENDS = 15
# Least share of the pictures that are numbered, or the trigger is not what it should be.
_MIN_KEPT = 0.5
# Code of a view whose pictures cannot be numbered, and of one whose grid moves in the sweep.
REFUSED, SLIPPED = 'TRIGGER_REFUSED', 'SLIPPED'


@dataclass(frozen=True, kw_only=True)
class TriggerCheck:
    """
    Numbering of the pictures of one view by the steps of the trigger.

    step : trigger_step, radians
    pictures, kept : number of pictures at constant speed, and of those that were numbered
    dropped : steps between the first and the last one without a picture that could be kept
    dropped_angles : table angles of these, radians
    doubled : pictures left out because another one is of the same step
    spurious : pictures left out because they are off the grid
    scatter : radians, robust standard deviation of the fitted angles about the grid
    phase : radians, 0 to ``step``
    shared : the phase is that of all views in this direction
    code : '' where the pictures are numbered; TRIGGER_REFUSED or SLIPPED where the view keeps its
        fitted angles
    detail : what was found, '' for nothing
    """

    step: float
    pictures: int = 0
    kept: int = 0
    dropped: int = 0
    dropped_angles: tuple[float, ...] = ()
    doubled: int = 0
    spurious: int = 0
    scatter: float = 0.0
    phase: float = 0.0
    shared: bool = False
    code: str = ''
    detail: str = ''


class TriggerGrid:
    """
    Grid of the trigger's steps in the fitted angles of one sweep.

    direction : 1 or -1, of the table
    uncertainty : radians, standard deviation of the fitted angle of the last picture against that
        of the first
    phase : in steps
    common : phase of all sweeps in this direction, in steps; NaN unless it is shared
    scatter : robust standard deviation of the fitted angles about the grid, in steps
    code, detail : as in TriggerCheck
    """

    def __init__(
        self, angles: Floats, step: float, *, direction: int = 1, uncertainty: float = 0.0
    ) -> None:
        """
        Find the grid.

        angles : (n,) radians, in the order of the stamps
        step : radians, positive
        """
        self.step, self.direction, self.uncertainty = step, direction, uncertainty
        self.code = self.detail = ''
        self.phase, self.common, self.scatter = 0.0, math.nan, 0.0
        self._fitted = angles
        # fitted angles, and their drift against the grid, in steps
        self._position = angles / step
        self._drift = np.zeros(len(angles))
        self._find()

    @property
    def drift_limit(self) -> float:
        """Greatest difference of two phases of one grid, in steps."""
        limit = _DRIFT_SIGMAS * self.uncertainty / self.step
        return float(np.clip(limit, _MIN_DRIFT, _MAX_DRIFT))

    @property
    def numbers(self) -> Ints:
        """(n,) number of the step of each picture."""
        return np.round(self._position - self.phase - self._drift).astype(np.int64)

    @property
    def angles(self) -> Floats:
        """(n,) angle of the step of each picture, radians."""
        phase = self.phase
        if math.isfinite(self.common):
            phase += float(_wrapped(np.array(self.common - self.phase)))
        return np.asarray((self.numbers + phase) * self.step)

    def numbered(self) -> tuple[Ints, TriggerCheck]:
        """Return the (k,) indices of the pictures that are kept, and the check."""
        check = TriggerCheck(
            step=self.step,
            pictures=len(self._fitted),
            scatter=self.scatter * self.step,
            code=self.code,
            detail=self.detail,
        )
        if self.code:
            return np.arange(len(self._fitted)), replace(check, kept=len(self._fitted))
        numbers, angles = self.numbers, self.angles
        chosen, is_shared = self._choose(numbers)
        kept = np.flatnonzero(chosen)
        if len(kept) < _MIN_KEPT * len(chosen):
            why = f'only {len(kept)} of {len(chosen)} pictures can be numbered'
            check = replace(check, kept=len(chosen), code=REFUSED, detail=why)
            return np.arange(len(chosen)), check
        every = np.arange(numbers[kept].min(), numbers[kept].max() + 1)
        missing = np.setdiff1d(every, numbers[kept])
        first = angles[kept[0]] - numbers[kept[0]] * self.step
        doubled = int(np.count_nonzero(is_shared & ~chosen))
        check = replace(
            check,
            kept=len(kept),
            dropped=len(missing),
            dropped_angles=tuple((first + missing * self.step).tolist()),
            doubled=doubled,
            spurious=len(chosen) - len(kept) - doubled,
            phase=float(first % self.step),
            shared=math.isfinite(self.common),
        )
        remarks = [text for text in (_remark(check), self.detail) if text]
        return kept, replace(check, detail=', '.join(remarks))

    def refuse(self, why: str) -> None:
        """Note why the pictures are not numbered."""
        self.code, self.detail = REFUSED, why

    # -- steps

    def _find(self) -> None:
        position = self._position
        if len(position) < _WINDOW:
            self.refuse(f'only {len(position)} pictures; at least {_WINDOW} are needed')
            return
        local, resultant = _local_phases(position)
        off = resultant < _MIN_RESULTANT
        if np.mean(off) > _MAX_OFF_WINDOWS:
            self.refuse(
                f'the pictures are not on a grid of {_degrees(self.step)}: wrong trigger_step, or '
                'the camera is not triggered'
            )
            return
        index = np.arange(len(position))
        known = np.unwrap(local[~off], period=1.0)
        self._drift = np.interp(index, index[~off], known)
        self.phase = float(np.median(known))
        self._drift = self._drift - self.phase
        residual = _wrapped(position - self.phase - self._drift)
        self.scatter = 1.4826 * float(np.median(np.abs(residual)))
        if self.scatter > _MAX_SCATTER:
            self.refuse(
                f'the fitted angles scatter by {_degrees(self.scatter * self.step)} about steps '
                f'of {_degrees(self.step)}, so that the step of a picture is not certain; the '
                'reports of the position are too irregular, or trigger_step is wrong'
            )
            return
        self._require_one_grid()

    def _require_one_grid(self) -> None:
        """Refuse a phase that changes in the sweep."""
        drift, position = self._drift, self._position
        if np.ptp(drift) <= self.drift_limit:
            return
        slope, offset = np.polyfit(position, drift, 1)
        bent = np.abs(drift - slope * position - offset).max()
        travel = float(np.ptp(position))
        is_even = bent <= max(0.5 * self.drift_limit, _MAX_BENT * np.ptp(drift))
        if is_even and abs(slope) * travel * self.step <= _DRIFT_SIGMAS * self.uncertainty:
            # the reports of a short sweep do not determine the speed better
            return
        if not is_even:
            jump = self._fitted[int(np.argmax(np.abs(np.diff(drift))))]
            where = f'from a table angle of {_degrees(jump)} on'
        elif abs(slope) * travel > _MAX_LOST:
            self.refuse(
                f'the pictures are {_degrees(self.step / (1.0 - slope))} or a multiple apart, '
                f'trigger_step is {_degrees(self.step)}'
            )
            return
        else:
            # both are lines in time, whenever the steps were lost
            where = (
                f'by {_degrees(slope * travel * self.step)} in a sweep of '
                f'{_degrees(travel * self.step)}'
            )
        self.code = SLIPPED
        self.detail = (
            f'triggers and reported positions disagree {where}: the table lost steps, or the '
            'trigger line lost or added some'
        )

    def _choose(self, numbers: Ints) -> tuple[Bools, Bools]:
        """Return which pictures are kept, and which share their step with another one, (n,)."""
        off = np.abs(self._position - self.phase - self._drift - numbers)
        near = off <= np.clip(_SIGMAS * self.scatter, _MIN_TOLERANCE, _MAX_TOLERANCE)
        # a step at a time, the nearest picture first
        order = np.lexsort((off, numbers))
        is_first = np.concatenate([[True], np.diff(numbers[order]) > 0])
        begins = np.flatnonzero(is_first)
        counts = np.diff(np.append(begins, len(order)))
        chosen = np.zeros(len(numbers), dtype=bool)
        is_shared = np.zeros(len(numbers), dtype=bool)
        is_shared[order] = np.repeat(counts > 1, counts)
        best = order[begins]
        second = order[np.minimum(begins + 1, len(order) - 1)]
        # two pictures at nearly the same distance: which one the pulse took cannot be told
        is_clear = (counts == 1) | ~near[second] | (off[second] - off[best] > self.scatter)
        chosen[best] = near[best] & is_clear
        return chosen & self._between_ramps(~near & ~is_shared), is_shared

    @staticmethod
    def _between_ramps(off: Bools) -> Bools:
        """Return which pictures lie between those off the grid at both ends, (n,) bool."""
        inside = np.ones(len(off), dtype=bool)
        first, last = np.flatnonzero(off[:_ENDS]), np.flatnonzero(off[-_ENDS:])
        if len(first):
            inside[: first[-1]] = False
        if len(last):
            inside[len(off) - _ENDS + last[0] :] = False
        return inside


def share_phases(grids: Sequence[TriggerGrid]) -> None:
    """
    Set the common phase of the sweeps in each direction, where their grids are one.

    Reports that are late shift the phase by the travel in the delay, which has the other sign in
    the other direction.
    """
    for direction in (-1, 1):
        same = [grid for grid in grids if grid.direction == direction]
        if not same:
            continue
        vectors = [len(grid.numbers) * np.exp(2j * np.pi * grid.phase) for grid in same]
        common = float(np.angle(np.sum(vectors)) / (2.0 * np.pi))
        apart = float(np.ptp(_wrapped(np.array([grid.phase - common for grid in same]))))
        is_one = apart <= max(grid.drift_limit for grid in same)
        for grid in same:
            if is_one:
                grid.common = common
            else:
                grid.detail = (
                    f'the steps of the sweeps are {_degrees(apart * grid.step)} apart by the '
                    'reported positions and not put on one grid'
                )


def _local_phases(position: Floats) -> tuple[Floats, Floats]:
    """
    Return the phase about each picture, and the resultant of the pictures there, both (n,).

    position : (n,) in steps
    """
    half = _WINDOW // 2
    # windows at the ends are those of the first and of the last full one
    center = np.clip(np.arange(len(position)), half, len(position) - 1 - half)
    windows = np.lib.stride_tricks.sliding_window_view(position, _WINDOW)[center - half]
    mean = np.exp(2j * np.pi * windows).mean(axis=1)
    phase = np.angle(mean) / (2.0 * np.pi)
    # doubled triggers are late: the median is robust to them
    return phase + np.median(_wrapped(windows - phase[:, None]), axis=1), np.abs(mean)


def _wrapped(values: Floats) -> Floats:
    """Return values without their whole steps, -0.5 to 0.5."""
    return np.asarray(values - np.round(values))


def _remark(check: TriggerCheck) -> str:
    """Return what was left out and what is missing, '' for nothing."""
    found = [
        f'{count} {what}'
        for count, what in (
            (check.dropped, 'steps without a picture'),
            (check.doubled, 'doubled pictures left out'),
            (check.spurious, 'pictures off the grid left out'),
        )
        if count
    ]
    return ', '.join(found)


def _degrees(angle: float) -> str:
    return f'{math.degrees(angle):.4g} degrees'
