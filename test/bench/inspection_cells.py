# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bench: 95 % intervals over cells that are miscalibrated within their stated covariance.

Points of an artefact are projected with the true cell and triangulated with the believed one. The
artefact has two spheres, an outer and an inner cylinder, two parallel planes and a hole.
"""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass
import os

import numpy as np
from support.cylinder_scan import stated_cell
from support.cylinder_scan import with_random_errors

from bench import at_least
from bench import Number
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.model import Floats

CELLS, SEED = 100, 29
NOISE = 0.02e-3  # meters, 1 sigma of a point
# Sets of noise from which the uncertainty due to it is computed.
_REPLICATES = 25
_MIN_FACING = 0.2  # cosine of a normal to the line of sight of a measured point
_SPHERES = ((0.035, 0.0, 0.060), (-0.035, 0.0, 0.060))
_SPHERE_RADIUS, _OUTER, _INNER, _HOLE = 0.010, 0.050, 0.020, 0.008
_HOLE_CENTER = (0.0, 0.035)
_PLANES = (0.010, 0.040)  # heights
# A wall is seen only to this depth below its rim.
_DEPTH = 0.004

Measure = Callable[[dict[str, Floats]], float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Points and normals of one feature, (n, 3) each, in ``turntable``."""

    points: Floats
    normals: Floats


def artefact() -> dict[str, Shape]:
    """Return the features of the artefact, by name."""
    shapes = {f'sphere {k}': _ball(center) for k, center in enumerate(_SPHERES)}
    shapes['outer'] = _wall(_OUTER, (0.0, 0.0), 0.012, 0.038, 1.0)
    shapes['inner'] = _wall(_INNER, (0.0, 0.0), _PLANES[1] - _DEPTH, _PLANES[1], -1.0)
    shapes['hole'] = _wall(_HOLE, _HOLE_CENTER, _PLANES[1] - _DEPTH, _PLANES[1], -1.0)
    for k, height in enumerate(_PLANES):
        shapes[f'plane {k}'] = _ring(height)
    return shapes


def _ball(center: tuple[float, float, float]) -> Shape:
    azimuth, polar = (
        a.ravel() for a in np.meshgrid(np.linspace(0, 6, 24), np.linspace(0.1, 2, 9))
    )
    normals = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1
    )
    return Shape(points=np.array(center) + _SPHERE_RADIUS * normals, normals=normals)


def _wall(
    radius: float, center: tuple[float, float], low: float, high: float, side: float
) -> Shape:
    grid = np.meshgrid(np.linspace(0, 2 * np.pi, 36, endpoint=False), np.linspace(low, high, 6))
    azimuth, height = (a.ravel() for a in grid)
    normals = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))], axis=1)
    middle = np.stack([np.full(len(height), x) for x in center], axis=1)
    points = radius * normals + np.column_stack([middle, height])
    return Shape(points=points, normals=side * normals)


def _ring(height: float) -> Shape:
    grid = np.meshgrid(np.linspace(0, 6, 30), np.linspace(0.024, 0.048, 6))
    azimuth, radius = (a.ravel() for a in grid)
    points = np.stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(len(radius), height)], axis=1
    )
    return Shape(points=points, normals=np.tile([0.0, 0.0, 1.0], (len(points), 1)))


def measured(true: Cell, believed: Cell, shape: Shape, rng: np.random.Generator) -> Shape:
    """Return the points that a cell measures and another one triangulates, with noise."""
    points, normals = [], []
    for index, laser in enumerate(true.lasers):
        for angle in _angles(true, index, shape.points):
            turned = transforms.rotation_z(np.nan_to_num(angle))
            base = np.einsum('nij,nj->ni', turned, shape.points)
            seen = transforms.apply(true.turntable.camera_from_base, base)
            n = np.einsum('nij,nj->ni', turned, shape.normals)
            n = n @ true.turntable.camera_from_base[:3, :3].T
            facing = -(n * seen).sum(axis=1) / np.linalg.norm(seen, axis=1)
            good = np.isfinite(angle) & (facing > _MIN_FACING)
            assert np.abs(laser.distance(seen[good])).max(initial=0.0) < 1e-9
            rays = believed.camera.rays(true.camera.project(seen[good]))
            found = believed.lasers[index].intersect(rays)
            inverse = transforms.invert(believed.turntable.camera_from_base)
            back = np.einsum('nji,nj->ni', turned[good], transforms.apply(inverse, found))
            points.append(back)
            normals.append(shape.normals[good])
    cloud, outward = np.concatenate(points), np.concatenate(normals)
    noise = rng.normal(scale=NOISE, size=len(cloud))
    return Shape(points=cloud + noise[:, None] * outward, normals=outward)


def _angles(cell: Cell, laser: int, points: Floats) -> Floats:
    """Return both table angles at which each point lies in a laser plane, (2, n); NaN if never."""
    T, plane = cell.turntable.camera_from_base, cell.lasers[laser]
    n = plane.normal @ T[:3, :3]
    level = -(plane.offset + plane.normal @ T[:3, 3] + n[2] * points[:, 2])
    # n.x of a point turned by the angle: a cos + b sin
    a, b = points[:, :2] @ n[:2], points[:, 0] * n[1] - points[:, 1] * n[0]
    with np.errstate(invalid='ignore', divide='ignore'):
        half = np.arccos(level / np.hypot(a, b))
    middle = np.arctan2(b, a)
    return np.stack([middle + half, middle - half])


def quantities() -> dict[str, tuple[Measure, float]]:
    """Return how each quantity is measured from points by feature, and its true value, meters."""

    def fit(kind: str, points: Floats) -> features.Feature:
        axis = np.array([0.0, 0.0, 1.0]) if kind == 'cylinder' else None
        return features.fit(kind, points, axis, fixed=False)

    def hole(at: dict[str, Floats]) -> float:
        datum, own = fit('cylinder', at['outer']), fit('circle', at['hole'])
        height = (own.center_xyz - datum.center_xyz)[2] / datum.axis[2]
        return float(np.hypot(*(own.center_xyz - datum.center_xyz - height * datum.axis)[:2]))

    def distance(at: dict[str, Floats]) -> float:
        lower, upper = fit('plane', at['plane 0']), fit('plane', at['plane 1'])
        return float((upper.center_xyz - lower.center_xyz) @ lower.axis * np.sign(lower.axis[2]))

    def spheres(at: dict[str, Floats]) -> float:
        first, second = (fit('sphere', at[f'sphere {k}']).center_xyz for k in (0, 1))
        return float(np.linalg.norm(first - second))

    return {
        'sphere diameter': (lambda at: fit('sphere', at['sphere 0']).diameter, 2 * _SPHERE_RADIUS),
        'outer cylinder diameter': (lambda at: fit('cylinder', at['outer']).diameter, 2 * _OUTER),
        'inner cylinder diameter': (lambda at: fit('circle', at['inner']).diameter, 2 * _INNER),
        'sphere distance': (spheres, 0.070),
        'plane distance': (distance, _PLANES[1] - _PLANES[0]),
        'flatness': (lambda at: bend(at['plane 1']), 0.0),
        'hole position': (hole, _HOLE_CENTER[1]),
    }


def bend(points: Floats) -> float:
    """
    Return the deviation from a plane by its largest smooth part: a cone about the table axis.

    A range of residuals is never negative and has no interval around 0. The height of the middle
    of a ring over its rim may have either sign.
    """
    radius = np.hypot(points[:, 0], points[:, 1])
    columns = np.stack([np.ones(len(points)), points[:, 0], points[:, 1], radius], axis=1)
    slope = np.linalg.lstsq(columns, points[:, 2], rcond=None)[0][3]
    return float(slope * np.ptp(radius))


def run() -> Iterator[Number]:
    """Count how many 95 % intervals hold the truth."""
    cells = int(os.environ.get('IVFMC_BENCH_CELLS', CELLS))
    rng = np.random.default_rng(SEED)
    true, shapes = stated_cell(), artefact()
    held: dict[str, list[bool]] = {name: [] for name in quantities()}
    widths: dict[str, list[float]] = {name: [] for name in quantities()}
    for _ in range(cells):
        believed = with_random_errors(true, rng)
        seen = {name: measured(true, believed, shape, rng) for name, shape in shapes.items()}
        for name, (off, u) in errors(believed, seen).items():
            held[name].append(abs(off) <= 1.96 * u)
            widths[name].append(2 * 1.96 * u)
    for name, holds in held.items():
        share = 100.0 * float(np.mean(holds))
        note = (
            f'{sum(holds)} of {cells} cells, median width {np.median(widths[name]) * 1e3:.4f} mm'
        )
        title = f'95 % interval of {name} holds the truth'
        yield Number(title, share, '%', at_least(90), note)


def errors(believed: Cell, seen: dict[str, Shape]) -> dict[str, tuple[float, float]]:
    """Return the error of each quantity and its standard uncertainty, meters."""
    names = list(seen)
    places = np.cumsum([0, *(len(seen[name].points) for name in names)])
    points = np.concatenate([seen[name].points for name in names])
    normals = np.concatenate([seen[name].normals for name in names])
    modes = calibration_modes(believed, points, normals)
    # other noise for each cell
    rng = np.random.default_rng(int(abs(points[0, 0]) * 1e12))

    def split(xyz: Floats) -> dict[str, Floats]:
        pieces = zip(names, places[:-1], places[1:], strict=True)
        return {name: xyz[a:b] for name, a, b in pieces}

    found = {}
    for name, (measure, truth) in quantities().items():
        value = measure(split(points))
        calibration = modes.propagate(lambda xyz, m=measure: m(split(xyz)), points)
        noisy = [
            measure(split(points + rng.normal(scale=NOISE, size=(len(points), 1)) * normals))
            for _ in range(_REPLICATES)
        ]
        found[name] = value - truth, float(np.hypot(calibration, np.std(noisy, ddof=1)))
    return found
