# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What sees a cell that was knocked after its calibration, and from what size on."""

from collections.abc import Callable
from collections.abc import Iterator

import numpy as np
from support.artifact_scan import ball_bar_points
from support.artifact_scan import CENTERS
from support.artifact_scan import RADIUS
from support.artifact_scan import with_focal_length
from support.artifact_scan import with_moved_table
from support.artifact_scan import with_turned_laser

from bench import at_most
from bench import Number
from ivfmc_ros.acceptance.artifact import parse_artifact
from ivfmc_ros.acceptance.check import check_artifact
from ivfmc_ros.acceptance.points import MeasuredPoints
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.simulation.bench import bench_cell

_BAR = parse_artifact('ball_bar:20mm:100mm', u=0.5e-6)
# Sizes that are tried, as multiples of the one that the issue names.
_FACTORS = (0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
# Meters between the surfaces of two lasers from which a scan advises to calibrate again: four
# times the noise of a single point (``registration.misfit``), 0.01 mm in this cell.
_MISFIT = 40e-6

Knock = Callable[[Cell, float], Cell]
KNOCKS: dict[str, tuple[Knock, float, str]] = {
    'laser turned about its upright': (
        lambda cell, size: with_turned_laser(cell, 0, size),
        0.05,
        'deg',
    ),
    'laser rolled about its beam': (
        lambda cell, size: with_turned_laser(cell, 0, size, 'beam'),
        0.05,
        'deg',
    ),
    'axis moved across the camera': (
        lambda cell, size: with_moved_table(cell, np.array([0.0, 1e-3 * size, 0.0])),
        0.1,
        'mm',
    ),
    'axis moved towards the camera': (
        lambda cell, size: with_moved_table(cell, np.array([1e-3 * size, 0.0, 0.0])),
        0.1,
        'mm',
    ),
    'f longer': (lambda cell, size: with_focal_length(cell, size / 100), 0.2, '%'),
    'platter raised': (
        lambda cell, size: with_moved_table(cell, np.array([0.0, 0.0, 1e-3 * size])),
        0.1,
        'mm',
    ),
    'table tilted': (
        lambda cell, size: with_moved_table(cell, np.zeros(3), np.radians(size)),
        0.05,
        'deg',
    ),
}


def knocked() -> Iterator[Number]:
    """Yield for each knock the least size that the check, and the lasers of any scan, see."""
    cell = bench_cell()
    failed, _, figures = _seen(cell, cell)
    yield Number('no knock: ball bar check fails', float(failed), '', at_most(0), figures)
    for name, (knock, size, unit) in KNOCKS.items():
        found = [_seen(cell, knock(cell, factor * size)) for factor in _FACTORS]
        for way, column in (('ball bar check fails', 0), ('lasers disagree in a scan', 1)):
            sizes = [
                factor * size for factor, seen in zip(_FACTORS, found, strict=True) if seen[column]
            ]
            note = f'at {size:g} {unit}: {found[_FACTORS.index(1.0)][2]}'
            least = min(sizes, default=float('nan'))
            yield Number(f'{name}: {way} from', least, unit, None, note)


def _seen(calibrated: Cell, true: Cell) -> tuple[bool, bool, str]:
    """Return whether the check fails, whether the lasers disagree, and the figures, mm."""
    points, normals = ball_bar_points(true, calibrated)
    check = check_artifact(_BAR, MeasuredPoints(points_xyz=points, normals=normals))
    apart = _laser_distance(calibrated, true)
    figures = ', '.join(
        f'{one.symbol.split()[0]} {one.value * 1e3:.3f}' for one in check.characteristics
    )
    return check.verdict == 'fail', apart > _MISFIT, f'{figures}, lasers {apart * 1e3:.3f} mm'


def _laser_distance(calibrated: Cell, true: Cell) -> float:
    """Return the rms distance of the second laser's points from the first one's spheres."""
    squares = []
    for center in CENTERS:
        one, two = (
            _of_sphere(ball_bar_points(true, calibrated, (laser,))[0], center) for laser in (0, 1)
        )
        middle, radius = _sphere(one)
        squares.append((np.linalg.norm(two - middle, axis=1) - radius) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _of_sphere(points, center):
    return points[np.linalg.norm(points - center, axis=1) < 1.5 * RADIUS]


def _sphere(points):
    A = np.column_stack([2 * points, np.ones(len(points))])
    solved = np.linalg.lstsq(A, (points**2).sum(axis=1), rcond=None)[0]
    return solved[:3], float(np.sqrt(solved[3] + solved[:3] @ solved[:3]))
