# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where each view belongs: the table's word, checked by ICP where views overlap."""

from collections.abc import Sequence

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.icp import icp
from ivfmc_ros.registration.icp import IcpResult
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.table import joint_poses
from ivfmc_ros.registration.views.assemble import grid_normals
from ivfmc_ros.validation import require_one_of

__all__ = ['METHODS', 'Verdict', 'align']

METHODS = ('table', 'paper', 'point_to_plane', 'joint')

# A view that shares less than this with those before it is not moved.
_MIN_OVERLAP = 0.2
# The fit must gain this much, or a round part would spin in search of a better sampling.
_MIN_GAIN = 0.95
_MAX_POINTS = 60_000


def align(
    views: Sequence[View], method: str, reach: float = 1.5e-3, prior: TablePrior | None = None
) -> tuple[Poses, list[Verdict]]:
    """
    Find the pose of every view, with the table's angle as the first guess.

    The first view defines the frame. With 'paper' (point-to-point ICP) and 'point_to_plane'
    each further one is moved onto those before it; 'joint' moves all at once, as far as they
    tell more than the prior; 'table' believes the table.

    reach : metres, points farther apart are no partners
    prior : how far the table may err, for 'joint'
    :raises ParameterError: no such method
    :raises GeometryError: a view has points that no table carries
    """
    require_one_of('registration', method, METHODS)
    if method == 'joint':
        return joint_poses(views, prior or TablePrior(), reach)
    poses = [np.eye(4) for _ in views]
    verdicts = [Verdict(view=view.number, applied=False, why='reference') for view in views[:1]]
    known = [_oriented(view) for view in views[:1]]
    for index, view in enumerate(views[1:], start=1):
        cloud = _oriented(view)
        if method == 'table':
            verdict = Verdict(view=view.number, applied=False, why='table believed, not checked')
        else:
            verdict, poses[index] = _place(view, cloud, np.concatenate(known), method, reach)
        verdicts.append(verdict)
        known.append(_turned(cloud, poses[index]))
    return Poses(turntable_from_view=np.array(poses).reshape(-1, 4, 4)), verdicts


def _oriented(view: View) -> Floats:
    """Return (n, 6) points and normals, thinned evenly over the surface."""
    cloud = np.concatenate([view.points_xyz, grid_normals(view)], axis=2).reshape(-1, 6)
    return _thinned(cloud[np.isfinite(cloud).all(axis=1)])


def _turned(cloud: Floats, T: Floats) -> Floats:
    return np.hstack([transforms.apply(T, cloud[:, :3]), cloud[:, 3:] @ T[:3, :3].T])


def _place(
    view: View, cloud: Floats, known: Floats, method: str, reach: float
) -> tuple[Verdict, Floats]:
    try:
        found = icp(
            cloud[:, :3],
            known[:, :3],
            known[:, 3:],
            np.eye(4),
            reach=reach,
            method='paper' if method == 'paper' else 'point_to_plane',
        )
    except GeometryError as error:
        return Verdict(view=view.number, applied=False, why=f'not checked: {error}'), np.eye(4)
    why = _objection(found, reach)
    T = found.target_from_source
    cosine = np.clip((np.trace(T[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)
    verdict = Verdict(
        view=view.number,
        applied=why == '',
        why=why or 'moved',
        overlap=found.overlap,
        rms_before=found.rms_before,
        rms_after=found.rms_after,
        rotation=float(np.arccos(cosine)),
        translation=float(np.linalg.norm(T[:3, 3])),
        converged=found.converged,
    )
    return verdict, T if verdict.applied else np.eye(4)


def _objection(found: IcpResult, reach: float) -> str:
    """Return why a result must not be used; empty if it may."""
    if found.overlap < _MIN_OVERLAP:
        return f'table believed: only {found.overlap:.0%} overlap'
    if not found.converged:
        return 'table believed: ICP did not converge'
    if found.rms_after >= _MIN_GAIN * found.rms_before:
        return 'table believed: ICP fits no better'
    if np.linalg.norm(found.target_from_source[:3, 3]) > 2.0 * reach:
        return 'table believed: the correction is larger than the table could err'
    return ''


def _thinned(cloud: Floats) -> Floats:
    """Return at most about _MAX_POINTS rows of (n, 6), evenly over the surface."""
    if len(cloud) <= _MAX_POINTS:
        return cloud
    size = float(np.linalg.norm(np.ptp(cloud[:, :3], axis=0)))
    # a surface of this size fills (size / edge)^2 voxels; points stay measured ones, not means
    edge = size / np.sqrt(_MAX_POINTS)
    voxels = np.floor(cloud[:, :3] / edge).astype(np.int64)
    _, first = np.unique(voxels, axis=0, return_index=True)
    return np.asarray(cloud[np.sort(first)])
