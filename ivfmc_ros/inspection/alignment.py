# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Alignment of measured points to a nominal surface.

A global search by principal axes is refined by point-to-plane ICP (Chen & Medioni 1992) without
outliers; datum points are aligned in closed form (Kabsch 1976).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface
from ivfmc_ros.validation import require_one_of

# Points and iterations of the global search and of the final fit.
_COARSE_POINTS, _FINE_POINTS = 1500, 20_000
_COARSE_ITERATIONS, _FINE_ITERATIONS = 12, 40
# Points of the fit are at most this many times as far as this fraction of all: four sigmas of
# noise. A fixed share would leave out a face that is off by a little more than its opposite one,
# and with it the reason to lie between both.
_INLIERS, _OUTLYING = 0.7, 4.0
# Fraction of the points with the smallest distances that candidate poses are compared by.
_TRIM = 0.9
# Fraction of the points that best fit within tolerance uses, and the greatest distance that counts
# more, tolerances.
_KEPT, _MAX_EXCESS = 0.999, 10.0
# Candidate poses of the global search that are refined.
_REFINED_CANDIDATES = 12
# Rotations about an axis that are tried where the principal axes are ambiguous.
_AXIS_ROTATIONS = 12
# Two principal extents are ambiguous if they differ by less than this fraction.
_AMBIGUOUS_EXTENTS = 0.25
# Convergence: largest component of a step, radians or meters.
_MIN_STEP = 1e-9
# Relative singular value below which a direction is not constrained by the surface.
_RCOND = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """
    Transform from the mesh to the nominal, and the residual of the points.

    nominal_from_mesh : (4, 4)
    rms : meters, of the trimmed point-to-surface distances, or of the datum points
    method : one of ``settings.ALIGNMENTS``
    """

    nominal_from_mesh: Floats
    rms: float
    method: str


def align(
    points_xyz: Floats,
    nominal: Surface,
    vertices_xyz: Floats,
    method: str,
    tolerance: float = 0.1e-3,
) -> Alignment:
    """
    Align points to a nominal surface.

    points_xyz : (n, 3) meters
    vertices_xyz : (m, 3) meters, of the nominal
    method : best_fit (from the current pose), within_tolerance (best fit, then the smallest excess
        over the tolerance), global (from any pose) or none
    tolerance : meters, for within_tolerance
    :raises ParameterError: unknown method
    :raises GeometryError: fewer than 6 points
    """
    require_one_of('align', method, ('best_fit', 'within_tolerance', 'global', 'none'))
    if len(points_xyz) < 6:
        raise GeometryError(f'align: {len(points_xyz)} points, at least 6 are needed')
    points = _downsampled(points_xyz, _FINE_POINTS)
    T = np.eye(4)
    if method == 'global':
        T = _global_start(_downsampled(points_xyz, _COARSE_POINTS), nominal, vertices_xyz)
    if method != 'none':
        T = _fit(points, nominal, T, _FINE_ITERATIONS)
    if method == 'within_tolerance':
        T = _minimize_excess(points, nominal, T, tolerance)
    return Alignment(nominal_from_mesh=T, rms=_cost(points, nominal, T), method=method)


def align_datums(measured_xyz: Floats, nominal_xyz: Floats) -> Alignment:
    """
    Align measured datum points to nominal ones, both (n, 3) meters, in the same order.

    :raises GeometryError: fewer than three points, different numbers of points, or collinear ones
    """
    if len(measured_xyz) != len(nominal_xyz) or len(measured_xyz) < 3:
        raise GeometryError('datum: needs three or more points, as many nominal as measured')
    a, b = measured_xyz.mean(axis=0), nominal_xyz.mean(axis=0)
    u, sizes, vt = np.linalg.svd((measured_xyz - a).T @ (nominal_xyz - b))
    if sizes[1] < 1e-6 * sizes[0]:
        raise GeometryError('datum: the points are collinear and do not determine a rotation')
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    R = vt.T @ flip @ u.T
    T = transforms.rigid(R, b - R @ a)
    residuals = transforms.apply(T, measured_xyz) - nominal_xyz
    return Alignment(
        nominal_from_mesh=T,
        rms=float(np.sqrt((residuals**2).sum(axis=1).mean())),
        method='datum',
    )


def _downsampled(points: Floats, count: int) -> Floats:
    if len(points) <= count:
        return points
    chosen = np.random.default_rng(0).choice(len(points), count, replace=False)
    return np.asarray(points[np.sort(chosen)])


def _cost(points: Floats, nominal: Surface, T: Floats) -> float:
    distance = np.sort(nominal.nearest(transforms.apply(T, points)).distance)
    return float(np.sqrt(np.mean(distance[: max(6, int(_TRIM * len(distance)))] ** 2)))


def _fit(points: Floats, nominal: Surface, T: Floats, iterations: int) -> Floats:
    """Minimize point-to-plane distances to the nearest faces by Gauss-Newton, without outliers."""
    for _ in range(iterations):
        moved = transforms.apply(T, points)
        near = nominal.nearest(moved)
        used = near.distance <= _OUTLYING * np.quantile(near.distance, _INLIERS)
        center = moved[used].mean(axis=0)
        lever, n = moved[used] - center, near.normals[used]
        gap = (n * (near.points_xyz[used] - moved[used])).sum(axis=1)
        step, motion = _solved(lever, n, gap, center)
        T = motion @ T
        if np.abs(step).max() < _MIN_STEP:
            break
    return T


def _solved(
    lever: Floats, n: Floats, gap: Floats, center: Floats, weight: Floats | float = 1.0
) -> tuple[Floats, Floats]:
    """Return the rotation and translation about ``center`` that close the gaps, and the motion."""
    A = np.concatenate([np.cross(lever, n), n], axis=1)
    # unconstrained directions (such as the rotation of a round part) get no step
    rows = np.reshape(weight, (-1, 1))
    step = np.linalg.lstsq(rows * A, weight * gap, rcond=_RCOND)[0]
    R = _rotation(step[:3])
    return step, transforms.rigid(R, center + step[3:] - R @ center)


def _minimize_excess(points: Floats, nominal: Surface, T: Floats, tolerance: float) -> Floats:
    """
    Minimize the sum of the eighth powers of distance over tolerance.

    Iteratively reweighted least squares (Lawson 1961): what is within the tolerance hardly counts.
    Points that the best fit leaves out stay left out.
    """
    distance = nominal.nearest(transforms.apply(T, points)).distance
    points = points[distance <= np.quantile(distance, _KEPT)]
    for _ in range(_FINE_ITERATIONS):
        moved = transforms.apply(T, points)
        near = nominal.nearest(moved)
        weight = np.minimum(near.distance / tolerance, _MAX_EXCESS) ** 3 + 1e-3
        center, n = moved.mean(axis=0), near.normals
        gap = (n * (near.points_xyz - moved)).sum(axis=1)
        step, motion = _solved(moved - center, n, gap, center, weight)
        T = motion @ T
        if np.abs(step).max() < _MIN_STEP:
            break
    return T


def _global_start(points: Floats, nominal: Surface, vertices: Floats) -> Floats:
    tried: list[tuple[float, int, Floats]] = []
    surface = _downsampled(vertices, _COARSE_POINTS)
    for T in _poses(points, surface):
        tried.append((_cost(points[::5], nominal, T), len(tried), T))
    tried.sort(key=lambda item: item[:2])
    fitted = [
        _fit(points, nominal, T, _COARSE_ITERATIONS) for *_, T in tried[:_REFINED_CANDIDATES]
    ]
    return min(fitted, key=lambda T: _cost(points, nominal, T))


def _poses(points: Floats, surface: Floats) -> Iterator[Floats]:
    """Yield poses that align the principal axes, in all directions and ambiguous rotations."""
    a, axes_a, _ = _principal(points)
    b, axes_b, sizes = _principal(surface)
    rotations = [np.eye(3)]
    for axis in range(3):
        others = np.delete(sizes, axis)
        if others.min() > (1.0 - _AMBIGUOUS_EXTENTS) * others.max():
            angles = 2.0 * np.pi * np.arange(1, _AXIS_ROTATIONS) / _AXIS_ROTATIONS
            rotations += [_rotation(angle * np.eye(3)[axis]) for angle in angles]
    for signs, rotation in product(product((1.0, -1.0), repeat=2), rotations):
        flip = np.diag([*signs, signs[0] * signs[1]])
        R = axes_b @ rotation @ flip @ axes_a.T
        yield transforms.rigid(R, b - R @ a)


def _principal(points: Floats) -> tuple[Floats, Floats, Floats]:
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    _, sizes, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axes = axes.T
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return middle, axes, sizes


def _rotation(vector: Floats) -> Floats:
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
