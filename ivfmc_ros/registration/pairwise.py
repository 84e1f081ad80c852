# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairwise registration: each view is aligned by ICP to the union of the views before it."""

from collections.abc import Sequence

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.icp import icp
from ivfmc_ros.registration.icp import IcpResult
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.views.assemble import grid_normals

# A view of which a smaller share overlaps those before it keeps the table's pose.
_MIN_OVERLAP = 0.2
# The rms must fall below this share of what it was; otherwise a round part would rotate to where
# the two samplings happen to coincide.
_MAX_RMS_RATIO = 0.95
# A translation of more than so many correspondence distances is not within the table's error.
_MAX_TRANSLATION = 2.0
# Points of a view that enter ICP.
_MAX_POINTS = 60_000


def register_pairwise(
    views: Sequence[View], method: str, max_correspondence_distance: float
) -> tuple[Poses, list[Verdict]]:
    """
    Align each view to those before it; the first view defines the frame.

    method : 'paper' (point-to-point), 'point_to_plane', or 'table', which keeps the table's poses
    max_correspondence_distance : meters
    """
    poses = [np.eye(4) for _ in views]
    verdicts = [Verdict(view=view.number, applied=False, why='reference') for view in views[:1]]
    known = [_oriented_points(view) for view in views[:1]]
    for index, view in enumerate(views[1:], start=1):
        cloud = _oriented_points(view)
        if method == 'table':
            verdict = Verdict(view=view.number, applied=False, why='table pose kept, not checked')
        else:
            verdict, poses[index] = _register(
                view, cloud, np.concatenate(known), method, max_correspondence_distance
            )
        verdicts.append(verdict)
        known.append(_transformed(cloud, poses[index]))
    return Poses(turntable_from_view=np.array(poses).reshape(-1, 4, 4)), verdicts


def _oriented_points(view: View) -> Floats:
    """Return (n, 6) points and normals, downsampled evenly over the surface."""
    cloud = np.concatenate([view.points_xyz, grid_normals(view)], axis=2).reshape(-1, 6)
    return _downsampled(cloud[np.isfinite(cloud).all(axis=1)])


def _transformed(cloud: Floats, T: Floats) -> Floats:
    return np.hstack([transforms.apply(T, cloud[:, :3]), cloud[:, 3:] @ T[:3, :3].T])


def _register(
    view: View, cloud: Floats, known: Floats, method: str, max_correspondence_distance: float
) -> tuple[Verdict, Floats]:
    try:
        result = icp(
            cloud[:, :3],
            known[:, :3],
            known[:, 3:],
            np.eye(4),
            max_correspondence_distance=max_correspondence_distance,
            method='paper' if method == 'paper' else 'point_to_plane',
        )
    except GeometryError as error:
        return Verdict(view=view.number, applied=False, why=f'not checked: {error}'), np.eye(4)
    why = _rejection(result, max_correspondence_distance)
    T = result.target_from_source
    cosine = np.clip((np.trace(T[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)
    verdict = Verdict(
        view=view.number,
        applied=why == '',
        why=why or 'moved',
        overlap=result.overlap,
        rms_before=result.rms_before,
        rms_after=result.rms_after,
        rotation=float(np.arccos(cosine)),
        translation=float(np.linalg.norm(T[:3, 3])),
        converged=result.converged,
        failed=result.overlap >= _MIN_OVERLAP and not result.converged,
    )
    return verdict, T if verdict.applied else np.eye(4)


def _rejection(result: IcpResult, max_correspondence_distance: float) -> str:
    """Return why a result is not applied; empty if it is."""
    if result.overlap < _MIN_OVERLAP:
        return f'table pose kept: only {result.overlap:.0%} overlap'
    if not result.converged:
        return 'table pose kept: ICP did not converge'
    if result.rms_after >= _MAX_RMS_RATIO * result.rms_before:
        return 'table pose kept: ICP does not improve the fit'
    translation = np.linalg.norm(result.target_from_source[:3, 3])
    if translation > _MAX_TRANSLATION * max_correspondence_distance:
        return "table pose kept: the correction exceeds the table's possible error"
    return ''


def _downsampled(cloud: Floats) -> Floats:
    """Return at most about _MAX_POINTS rows of (n, 6), evenly over the surface."""
    if len(cloud) <= _MAX_POINTS:
        return cloud
    size = float(np.linalg.norm(np.ptp(cloud[:, :3], axis=0)))
    # a surface of this size fills (size / voxel_size)^2 voxels; measured points, not means
    voxel_size = size / np.sqrt(_MAX_POINTS)
    voxels = np.floor(cloud[:, :3] / voxel_size).astype(np.int64)
    _, first = np.unique(voxels, axis=0, return_index=True)
    return np.asarray(cloud[np.sort(first)])
