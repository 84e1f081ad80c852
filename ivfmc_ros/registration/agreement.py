# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether surfaces that two lasers measured fit at all, within noise and stated calibration."""

import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.registration.sections import compare_at
from ivfmc_ros.registration.sections import Sections

# Surfels of a calibration without stated errors fit within this distance, meters: ten times the
# noise of a surfel of the bench cell.
_TOLERANCE = 1.2e-4
# Those of a poorer one fit within so many of its standard deviations.
_CALIBRATION_SIGMAS = 3.0
# Of the surfels on sides that two lasers measured, so many must fit. Chosen on a box, a tube and a
# wall of 2 mm, 80 profiles a turn: 0.76 with errors of the cell of up to 0.1 mm and 0.05 degrees,
# 0.05 at the wrong sense of rotation or with 0.3 mm and 0.15 degrees.
_MIN_SHARE, _MIN_SURFELS = 0.3, 50
# Sides have normals at a smaller cosine to the axis: top faces fit whatever the angle is.
_MAX_SIDE_COSINE = 0.8


def stated_rms(cell: Cell | None) -> float:
    """Return the rms residual of the calibration of axis and lasers together, meters."""
    if cell is None:
        return 0.0
    known = [cell.turntable.residual_rms, *(laser.residual_rms for laser in cell.lasers)]
    return math.hypot(*(value for value in known if math.isfinite(value)))


def max_difference(calibration_rms: float) -> float:
    """Return by how much two measurements of a surface may differ, meters."""
    return max(_TOLERANCE, _CALIBRATION_SIGMAS * calibration_rms)


def find_disagreement(sections: Sections, calibration_rms: float) -> str:
    """
    Return that the sides that two lasers measured do not fit; '' if they do.

    One laser measures a side once a turn: what it sees nearby at another time is another side.

    calibration_rms : meters, as the cell states it
    """
    tolerance = max_difference(calibration_rms)
    now = compare_at(sections, np.zeros(1), tolerance, lasers=True)
    sides = np.abs(sections.surfels.normals[:, 2]) < _MAX_SIDE_COSINE
    met = sides & (now.other[:, 0] >= 0)
    share = float(np.mean(now.fit[met, 0] > 0)) if met.any() else 1.0
    if np.count_nonzero(met) < _MIN_SURFELS or share >= _MIN_SHARE:
        return ''
    return (
        f'only {share:.0%} of the surface that two lasers measured fits within '
        f'{tolerance * 1e3:.2f} mm: the calibration of lasers or axis, the sense of rotation '
        'or the steps per turn are wrong'
    )
