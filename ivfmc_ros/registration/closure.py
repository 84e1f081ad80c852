# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Closure of a sweep: the rotation between surfels that one laser measured at one table angle twice.

Both measurements have the same errors of calibration and of the table's period, so that they
differ by noise and by what the table lost in between. The rotation about the axis is fitted to the
point-to-plane distances (least squares), which finds smaller slips than a search over rotations.
"""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.sections import Section
from ivfmc_ros.registration.sections import Sections
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.correspondences import find_correspondences
from ivfmc_ros.registration.solver.correspondences import search_window
from ivfmc_ros.registration.solver.surfels import concatenate_surfels

_TURN = 2.0 * math.pi
# Both measurements have the same errors of cell and table: a difference is a slip above this size,
# radians, and this number of standard deviations. In different sweeps the backlash of a table that
# turned back may be in it.
_MIN_SLIP, _MIN_SLIP_OF_VIEWS, _SIGMAS = math.radians(0.1), math.radians(0.25), 6.0
# Nor is it a slip below this share of the angle between profiles: surfels of profiles that are far
# apart share errors of the surface between them, which their scatter does not show. A good scan of
# a live cell, profiles 4.4 degrees apart, looked like 0.16 degrees with a sigma of 0.02.
_MIN_SLIP_SHARE = 0.06
# Sections whose table angles differ by less, radians, from whole turns measured one place: half
# the width of a section.
_SAME_ANGLE = math.radians(8.0)
# Greatest distance of two surfels along the normal, meters: a slip of 3 degrees on a radius of
# 30 mm. Larger slips are found by the search over rotations.
_MAX_DISTANCE = 1.5e-3
_MIN_CORRESPONDENCES = 20
# The normals must pass the axis at this distance, meters rms: else the surface is round.
_MIN_ARM = 1e-3
# Least number of surfels that hold the rotation, as Kish's effective sample size of their squared
# arms (Kish 1965): a few surfels at a hole or a keyway of a round part share one error of their
# sampling. The demo part, 100 profiles a turn, looked like -0.8 and -0.4 degrees with 11 and 15.
_MIN_EFFECTIVE = 20.0
# Iterations of correspondences and rotation; they settle in five.
_ITERATIONS = 8
_SETTLED = 1e-6  # radians
# Huber's threshold in robust deviations (Huber 1981: 95 % efficient), and the factor from the
# median absolute deviation to the standard deviation.
_HUBER, _MAD = 1.345, 1.4826


@dataclass(frozen=True, kw_only=True)
class Closure:
    """
    A part of a sweep that was measured again.

    before, after : the last section of the first measurement, the first section of the second
    size : radians by which the table lags the reported angle in the second one
    sigma : radians, 1 sigma of the size
    step : radians between profiles
    """

    before: Section
    after: Section
    size: float
    sigma: float
    step: float

    @property
    def is_slip(self) -> bool:
        """Whether the size is that of a slip: above the least one, and significant."""
        return abs(self.size) > max(self._least, _SIGMAS * self.sigma)

    @property
    def is_informative(self) -> bool:
        """Whether the least slip would be significant."""
        return _SIGMAS * self.sigma < self._least

    @property
    def _least(self) -> float:
        is_same = self.before.view == self.after.view
        least = _MIN_SLIP if is_same else _MIN_SLIP_OF_VIEWS
        return max(least, _MIN_SLIP_SHARE * self.step)


def find_closures(sections: Sections) -> list[Closure]:
    """Return the closures of all sweeps, as far as their surfaces constrain the rotation."""
    views = sorted({item.view for item in sections.items})
    found = []
    for early in views:
        for late in views:
            if sections.lasers[early] != sections.lasers[late]:
                continue
            pairs = list(repeated_sections(sections, early, late))
            step = max(sections.steps[early], sections.steps[late])
            closure = _fit(pairs, sections.spacing, step) if pairs else None
            if closure is not None:
                found.append(closure)
    return found


def repeated_sections(
    sections: Sections, early: int, late: int
) -> Iterator[tuple[Section, Section]]:
    """Yield the sections of one view that a later one measured again."""
    for first in sections.items:
        for second in sections.items:
            if (first.view, second.view) != (early, late) or not first.seq < second.seq:
                continue
            between = second.angle_from - first.angle_from
            turns = round(between / _TURN)
            is_repeated = abs(between - turns * _TURN) < _SAME_ANGLE
            if is_repeated and (turns != 0 or early != late):
                yield first, second


def _fit(pairs: list[tuple[Section, Section]], spacing: float, step: float) -> Closure | None:
    firsts = sorted({id(first): first for first, _ in pairs}.values(), key=lambda s: s.seq)
    seconds = sorted({id(second): second for _, second in pairs}.values(), key=lambda s: s.seq)
    fixed, moving = (
        concatenate_surfels([item.surfels for item in group]) for group in (firsts, seconds)
    )
    if not len(fixed) or not len(moving):
        return None
    window = search_window(_MAX_DISTANCE, spacing)
    size, sigma = 0.0, math.nan
    for _ in range(_ITERATIONS):
        T = transforms.rigid(transforms.rotation_z(size), (0.0, 0.0, 0.0))
        found = find_correspondences((0, 1), (moving, fixed), (T, np.eye(4)), window)
        if len(found) < _MIN_CORRESPONDENCES:
            return None
        change, sigma = _rotation(found)
        if not math.isfinite(change):
            return None
        size += change
        if abs(change) < _SETTLED:
            break
    return Closure(before=firsts[-1], after=seconds[0], size=size, sigma=sigma, step=step)


def _rotation(found: Correspondences) -> tuple[float, float]:
    """Return the rotation, radians, that brings the first surfels to the second, and 1 sigma."""
    normals, residuals = found.normals, found.residuals
    (x, y, _), (nx, ny, _) = found.midpoint.T, normals.T
    arms = x * ny - y * nx
    leverage = arms**2
    if np.sqrt(np.mean(leverage)) < _MIN_ARM:
        return math.nan, math.nan
    if leverage.sum() ** 2 < _MIN_EFFECTIVE * (leverage**2).sum():
        return math.nan, math.nan
    spread = _MAD * float(np.median(np.abs(residuals - np.median(residuals))))
    deviation = np.maximum(found.sigma, spread)
    rotation, information = 0.0, 0.0
    weight = np.ones(len(arms))
    for _ in range(_ITERATIONS):
        error = (residuals + rotation * arms) / deviation
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(error), 1e-12)) / deviation**2
        information = float((weight * leverage).sum())
        if not information > 0.0:
            return math.nan, math.nan
        rotation = -float((weight * arms * residuals).sum()) / information
    # the few surfels that hold the rotation scatter more than the many that do not (White 1980)
    scores = weight * arms * (residuals + rotation * arms)
    sandwich = float((scores**2).sum()) / information**2
    return rotation, math.sqrt(max(1.0 / information, sandwich))
