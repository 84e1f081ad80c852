# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairwise ICP: the paper's (point to point) and point to plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import open3d as o3d

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats

Method = Literal['paper', 'point_to_plane']

_MIN_POINTS = 30
_MIN_PAIRS = 30


@dataclass(frozen=True, eq=False, kw_only=True)
class IcpResult:
    """
    What ICP found.

    target_from_source : (4, 4) rigid
    pairs : how many source points have a target point within reach
    overlap : their share of the source
    rms_before, rms_after : metres, of the paired distances under the first guess and the result
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
    guess : (4, 4) target_from_source to start with
    reach : metres, points farther apart are no pair
    :raises GeometryError: too few points, or too few of them within reach of each other
    :raises ParameterError: no such method
    """
    if method not in ('paper', 'point_to_plane'):
        raise ParameterError(f"method: {method!r} is neither 'paper' nor 'point_to_plane'")
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
    if method != 'paper':
        target.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
    before = pipeline.evaluate_registration(source, target, reach, guess)
    if len(before.correspondence_set) < _MIN_PAIRS:
        raise GeometryError(
            f'ICP: only {len(before.correspondence_set)} points lie within {reach * 1e3:.2f} mm '
            'of the other view; the views do not overlap'
        )
    return _run(source, target, guess, reach, estimation, iterations, before.inlier_rmse)


def _run(
    source: o3d.geometry.PointCloud,
    target: o3d.geometry.PointCloud,
    guess: Floats,
    reach: float,
    estimation: o3d.pipelines.registration.TransformationEstimation,
    iterations: int,
    rms_before: float,
) -> IcpResult:
    pipeline = o3d.pipelines.registration
    T = np.asarray(guess, dtype=np.float64)
    converged = False
    previous = rms_before
    # in blocks, because open3d does not tell whether it stopped for convergence
    block = 10
    for _ in range(max(1, iterations // block)):
        criteria = pipeline.ICPConvergenceCriteria(1e-9, 1e-9, block)
        found = pipeline.registration_icp(source, target, reach, T, estimation, criteria)
        T = np.array(found.transformation)
        converged = abs(found.inlier_rmse - previous) <= 1e-6 * max(previous, 1e-9)
        previous = found.inlier_rmse
        if converged:
            break
    pairs = len(found.correspondence_set)
    return IcpResult(
        target_from_source=T,
        pairs=pairs,
        overlap=pairs / len(source.points),
        rms_before=float(rms_before),
        rms_after=float(previous),
        converged=converged,
    )


def _cloud(points_xyz: Floats) -> o3d.geometry.PointCloud:
    if not np.isfinite(points_xyz).all():
        raise GeometryError('ICP: a point is not finite; remove invalid points first')
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_xyz))
