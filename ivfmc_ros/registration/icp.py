# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairwise ICP: the paper's (point to point) and point to plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import open3d as o3d

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

Method = Literal['paper', 'point_to_plane']

_MIN_POINTS = 30
_MIN_PAIRS = 30
_BLOCK = 10


@dataclass(frozen=True, eq=False, kw_only=True)
class IcpResult:
    """
    What ICP found.

    target_from_source : (4, 4) rigid
    pairs : how many source points have a target point within reach
    overlap : their share of the source
    rms_before, rms_after : metres, of the pairs' distances along the surface's normal under the
        first guess and the result, without the worst tenth: the distance along the surface only
        tells where either scan happens to have its points
    converged : the error stopped to change before the iterations were used up
    """

    target_from_source: Floats
    pairs: int
    overlap: float
    rms_before: float
    rms_after: float
    converged: bool


def icp(
    source_xyz: Floats,
    target_xyz: Floats,
    target_normals: Floats,
    guess: Floats,
    *,
    reach: float,
    method: Method = 'point_to_plane',
    iterations: int = 60,
) -> IcpResult:
    """
    Move ``source_xyz`` onto ``target_xyz``.

    'paper' is Besl and McKay 1992: T minimises f(T) = 1/N sum |q_i - T p_i|^2 over closest
    points. 'point_to_plane' is Chen and Medioni 1992: only the distance along the target's
    normal counts, so that surfaces may slide along themselves; it converges in fewer steps.

    source_xyz, target_xyz : (n, 3) finite, metres
    target_normals : (n, 3) finite, unit, of either sense
    guess : (4, 4) target_from_source to start with
    reach : metres, points farther apart are no pair
    :raises GeometryError: too few points, or too few of them within reach of each other
    :raises ParameterError: no such method
    """
    require_one_of('method', method, ('paper', 'point_to_plane'))
    for name, points in (('source', source_xyz), ('target', target_xyz)):
        if len(points) < _MIN_POINTS:
            raise GeometryError(f'ICP: the {name} has {len(points)} points, {_MIN_POINTS} needed')
    source, target = _cloud(source_xyz), _cloud(target_xyz)
    pipeline = o3d.pipelines.registration
    estimation = (
        pipeline.TransformationEstimationPointToPoint()
        if method == 'paper'
        else pipeline.TransformationEstimationPointToPlane()
    )
    target.normals = o3d.utility.Vector3dVector(target_normals)
    before = pipeline.evaluate_registration(source, target, reach, guess)
    if len(before.correspondence_set) < _MIN_PAIRS:
        raise GeometryError(
            f'ICP: only {len(before.correspondence_set)} points lie within {reach * 1e3:.2f} mm '
            'of the other view; the views do not overlap'
        )
    found, converged = _iterate(source, target, guess, reach, estimation, iterations)
    pairs = len(found.correspondence_set)
    return IcpResult(
        target_from_source=np.array(found.transformation),
        pairs=pairs,
        overlap=pairs / len(source.points),
        rms_before=_rms_along_normal(source, target, before),
        rms_after=_rms_along_normal(source, target, found),
        converged=converged,
    )


def _iterate(
    source: o3d.geometry.PointCloud,
    target: o3d.geometry.PointCloud,
    guess: Floats,
    reach: float,
    estimation: o3d.pipelines.registration.TransformationEstimation,
    iterations: int,
) -> tuple[o3d.pipelines.registration.RegistrationResult, bool]:
    """Run ICP in blocks, because open3d does not tell whether it stopped for convergence."""
    pipeline = o3d.pipelines.registration
    T = np.asarray(guess, dtype=np.float64)
    previous = float('inf')
    for _ in range(max(1, iterations // _BLOCK)):
        criteria = pipeline.ICPConvergenceCriteria(1e-9, 1e-9, _BLOCK)
        found = pipeline.registration_icp(source, target, reach, T, estimation, criteria)
        T = np.array(found.transformation)
        if abs(found.inlier_rmse - previous) <= 1e-5 * previous:
            return found, True
        previous = found.inlier_rmse
    return found, False


def _rms_along_normal(
    source: o3d.geometry.PointCloud,
    target: o3d.geometry.PointCloud,
    result: o3d.pipelines.registration.RegistrationResult,
) -> float:
    pairs = np.asarray(result.correspondence_set)
    moved = transforms.apply(np.asarray(result.transformation), np.asarray(source.points))
    offset = moved[pairs[:, 0]] - np.asarray(target.points)[pairs[:, 1]]
    along = np.abs((offset * np.asarray(target.normals)[pairs[:, 1]]).sum(axis=1))
    best = np.sort(along)[: int(np.ceil(0.9 * len(along)))]
    return float(np.sqrt(np.mean(best**2)))


def _cloud(points_xyz: Floats) -> o3d.geometry.PointCloud:
    if not np.isfinite(points_xyz).all():
        raise GeometryError('ICP: a point is not finite; remove invalid points first')
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_xyz))
