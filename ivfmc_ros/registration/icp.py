# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ICP of two point clouds: point-to-point (the paper's method) and point-to-plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import open3d as o3d

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

Method = Literal['paper', 'point_to_plane']

# Fewer points, or fewer correspondences, do not determine a rigid motion reliably.
_MIN_POINTS = 30
_MIN_CORRESPONDENCES = 30
# Iterations between two checks for convergence.
_BLOCK = 10
# Converged when the rms changes by less than this share from one block to the next.
_TOLERANCE = 1e-5
# Share of the distances that enters a trimmed rms: without the worst tenth.
_TRIM = 0.9


@dataclass(frozen=True, eq=False, kw_only=True)
class IcpResult:
    """
    Result of ICP.

    target_from_source : (4, 4) rigid
    correspondences : number of source points with a target point within the maximum distance
    overlap : their share of the source
    rms_before, rms_after : meters, of the distances along the target's normal under the initial
        pose and the result, without the worst tenth. The distance along the surface is left out:
        it only depends on where the scans happen to be sampled
    converged : the rms became stationary before the maximum number of iterations
    """

    target_from_source: Floats
    correspondences: int
    overlap: float
    rms_before: float
    rms_after: float
    converged: bool


def icp(
    source_xyz: Floats,
    target_xyz: Floats,
    target_normals: Floats,
    initial: Floats,
    *,
    max_correspondence_distance: float,
    method: Method = 'point_to_plane',
    iterations: int = 60,
) -> IcpResult:
    """
    Align ``source_xyz`` to ``target_xyz``.

    'paper' is Besl and McKay 1992: T minimizes f(T) = 1/N sum |q_i - T p_i|^2 over closest
    points. 'point_to_plane' is Chen and Medioni 1992: only the distance along the target's
    normal counts, so that surfaces may slide along themselves; it converges in fewer steps.

    source_xyz, target_xyz : (n, 3) finite, meters
    target_normals : (n, 3) finite, unit, of either sense
    initial : (4, 4) target_from_source to start from
    max_correspondence_distance : meters, points farther apart do not correspond
    :raises GeometryError: too few points, too few correspondences, or a point is not finite
    :raises ParameterError: unknown method
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
    before = pipeline.evaluate_registration(source, target, max_correspondence_distance, initial)
    if len(before.correspondence_set) < _MIN_CORRESPONDENCES:
        raise GeometryError(
            f'ICP: only {len(before.correspondence_set)} points lie within '
            f'{max_correspondence_distance * 1e3:.2f} mm of the other view; the views do not '
            'overlap'
        )
    found, converged = _iterate(
        source, target, initial, max_correspondence_distance, estimation, iterations
    )
    count = len(found.correspondence_set)
    return IcpResult(
        target_from_source=np.array(found.transformation),
        correspondences=count,
        overlap=count / len(source.points),
        rms_before=_rms_along_normal(source, target, before),
        rms_after=_rms_along_normal(source, target, found),
        converged=converged,
    )


def _iterate(
    source: o3d.geometry.PointCloud,
    target: o3d.geometry.PointCloud,
    initial: Floats,
    max_correspondence_distance: float,
    estimation: o3d.pipelines.registration.TransformationEstimation,
    iterations: int,
) -> tuple[o3d.pipelines.registration.RegistrationResult, bool]:
    """Run ICP in blocks, because open3d does not report whether it converged."""
    pipeline = o3d.pipelines.registration
    T = np.asarray(initial, dtype=np.float64)
    previous = float('inf')
    for _ in range(max(1, iterations // _BLOCK)):
        criteria = pipeline.ICPConvergenceCriteria(1e-9, 1e-9, _BLOCK)
        found = pipeline.registration_icp(
            source, target, max_correspondence_distance, T, estimation, criteria
        )
        T = np.array(found.transformation)
        if abs(found.inlier_rmse - previous) <= _TOLERANCE * previous:
            return found, True
        previous = found.inlier_rmse
    return found, False


def _rms_along_normal(
    source: o3d.geometry.PointCloud,
    target: o3d.geometry.PointCloud,
    result: o3d.pipelines.registration.RegistrationResult,
) -> float:
    """Return the trimmed rms of the distances along the target's normals, meters."""
    matched = np.asarray(result.correspondence_set)
    moved = transforms.apply(np.asarray(result.transformation), np.asarray(source.points))
    difference = moved[matched[:, 0]] - np.asarray(target.points)[matched[:, 1]]
    distance = np.abs((difference * np.asarray(target.normals)[matched[:, 1]]).sum(axis=1))
    best = np.sort(distance)[: int(np.ceil(_TRIM * len(distance)))]
    return float(np.sqrt(np.mean(best**2)))


def _cloud(points_xyz: Floats) -> o3d.geometry.PointCloud:
    if not np.isfinite(points_xyz).all():
        raise GeometryError(
            'ICP: a point is not finite; remove invalid points before the registration'
        )
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_xyz))
