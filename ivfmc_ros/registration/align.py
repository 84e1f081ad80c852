# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where each view belongs: the table's word, checked by ICP where views overlap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import open3d as o3d

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.icp import icp
from ivfmc_ros.registration.icp import IcpResult

METHODS = ('table', 'paper', 'point_to_plane')

# A view that shares less than this with those before it is not moved.
_MIN_OVERLAP = 0.2
_MAX_POINTS = 60_000


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """
    What became of one view.

    applied : the view was moved; otherwise it stays where the table put it, and why says so
    overlap : share of the view's points with a partner in the views before it
    rms_before, rms_after : metres, of the partners' distances
    rotation, translation : radians and metres of what ICP found
    """

    view: int
    applied: bool
    why: str
    overlap: float = 0.0
    rms_before: float = float('nan')
    rms_after: float = float('nan')
    rotation: float = 0.0
    translation: float = 0.0


def align(
    views: Sequence[View], method: str, reach: float = 1.5e-3
) -> tuple[Poses, list[Verdict]]:
    """
    Find the pose of every view, with the table's angle as the first guess.

    The first view defines the frame; each further one is moved onto those before it.

    method : 'table' believes the table, 'paper' is point-to-point ICP, 'point_to_plane' the other
    reach : metres, points farther apart are no partners
    :raises ParameterError: no such method
    """
    if method not in METHODS:
        raise ParameterError(f'registration: {method!r} is not one of {", ".join(METHODS)}')
    poses = [np.eye(4) for _ in views]
    verdicts = [Verdict(view=view.number, applied=False, why='reference') for view in views[:1]]
    known = [_thinned(view.cloud()) for view in views[:1]]
    for index, view in enumerate(views[1:], start=1):
        cloud = _thinned(view.cloud())
        if method == 'table':
            verdict = Verdict(view=view.number, applied=False, why='table believed, not checked')
        else:
            verdict, poses[index] = _place(view, cloud, np.concatenate(known), method, reach)
        verdicts.append(verdict)
        known.append(transforms.apply(poses[index], cloud))
    return Poses(turntable_from_view=np.array(poses).reshape(-1, 4, 4)), verdicts


def _place(
    view: View, cloud: Floats, known: Floats, method: str, reach: float
) -> tuple[Verdict, Floats]:
    try:
        found = icp(
            cloud,
            known,
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
    )
    return verdict, T if verdict.applied else np.eye(4)


def _objection(found: IcpResult, reach: float) -> str:
    """Return why a result must not be used; empty if it may."""
    if found.overlap < _MIN_OVERLAP:
        return f'table believed: only {found.overlap:.0%} overlap'
    if not found.converged:
        return 'table believed: ICP did not converge'
    if found.rms_after >= 0.98 * found.rms_before:
        return 'table believed: ICP fits no better'
    if np.linalg.norm(found.target_from_source[:3, 3]) > 2.0 * reach:
        return 'table believed: the correction is larger than the table could err'
    return ''


def _thinned(cloud: Floats) -> Floats:
    """Return at most about _MAX_POINTS of the points, evenly over the surface."""
    if len(cloud) <= _MAX_POINTS:
        return cloud
    size = float(np.linalg.norm(np.ptp(cloud, axis=0)))
    # a surface of this size fills (size / edge)^2 voxels; points stay measured ones, not means
    edge = size / np.sqrt(_MAX_POINTS)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
    low, high = points.get_min_bound() - edge, points.get_max_bound() + edge
    _, _, members = points.voxel_down_sample_and_trace(edge, low, high)
    return np.asarray(cloud[[group[0] for group in members]])
