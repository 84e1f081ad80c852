# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Coarse point-to-plane ICP of many candidate poses, and removal of those that converge to one.

The residual is the symmetric point-to-plane distance (Rusinkiewicz 2019) on a random sample of
surfels, with correspondences from a voxel grid and robust weights.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.nearest_grid import NearestGrid
from ivfmc_ros.registration.merge.point_pair_features import CandidatePoses
from ivfmc_ros.registration.merge.point_pair_features import distinct_poses

# Greatest correspondence distances in steps of the candidates, coarse to fine, and the number of
# iterations at each.
_DISTANCES, _ITERATIONS = (2.0, 1.0, 0.5), 8
# Surfels that are aligned; more of them do not change which poses converge.
_POINTS = 1500
# Least cosine between the normals of a correspondence.
_MIN_COSINE = 0.8
# Poses that displace no point of the surface by more than this (in steps) are the same.
_SAME = 0.4
# Tikhonov damping, relative to the trace: motions that the surface does not constrain stay small.
_DAMPING = 1e-4
# Fewer correspondences do not determine six parameters reliably; iteration ends.
_MIN_CORRESPONDENCES = 30


def refine_candidates(
    source: ClampedSurface, target: ClampedSurface, candidates: CandidatePoses
) -> CandidatePoses:
    """
    Align the source to the target from every candidate pose.

    returns : distinct poses target_from_source, the best first; their overlap is the fraction of
        points with a correspondence at the last distance
    """
    rng = np.random.default_rng(0)
    sample = source.selected(rng.permutation(len(source))[:_POINTS])
    poses = candidates.poses
    for distance in _DISTANCES:
        icp = _PointToPlaneIcp(target, distance * candidates.step)
        found = [icp.align(sample, T) for T in poses]
        poses = np.array([T for T, _ in found]).reshape(-1, 4, 4)
    overlap = np.array([fraction for _, fraction in found])
    index = distinct_poses(poses, overlap, source.surfels.points_xyz, _SAME * candidates.step)
    return CandidatePoses(poses=poses[index], overlap=overlap[index], step=candidates.step)


class _PointToPlaneIcp:
    """Aligns surfaces to a target; max_distance : of correspondences, meters."""

    def __init__(self, target: ClampedSurface, max_distance: float) -> None:
        self._surfels = target.surfels
        self._max_distance = max_distance
        self._grid = NearestGrid.build(target.surfels.points_xyz, max_distance / 3, max_distance)

    def align(self, source: ClampedSurface, T: Floats) -> tuple[Floats, float]:
        """Return the pose after some iterations, and the fraction of points that correspond."""
        points, normals = source.surfels.points_xyz, source.surfels.normals
        overlap = 0.0
        for _ in range(_ITERATIONS):
            p, source_normals = transforms.apply(T, points), normals @ T[:3, :3].T
            j = self._grid.query(p)
            target_normals = self._surfels.normals[j]
            n = source_normals + target_normals
            compatible = (source_normals * target_normals).sum(axis=1) > _MIN_COSINE
            used = (j >= 0) & compatible
            overlap = float(used.mean())
            if used.sum() < _MIN_CORRESPONDENCES:
                break
            n = n[used] / np.linalg.norm(n[used], axis=1, keepdims=True)
            center = p[used].mean(axis=0)
            residuals = ((self._surfels.points_xyz[j[used]] - p[used]) * n).sum(axis=1)
            T = _step(p[used] - center, n, residuals, self._max_distance, center) @ T
        return T, overlap


def _step(
    offsets: Floats, n: Floats, residuals: Floats, max_distance: float, center: Floats
) -> Floats:
    """
    Return the (4, 4) Gauss-Newton step that reduces (k,) residuals along (k, 3) normals.

    offsets : (k, 3) of the points from ``center``, about which the step rotates
    """
    # Geman-McClure weights with a third of the correspondence distance as their width
    weight = 1.0 / (1.0 + (3.0 * residuals / max_distance) ** 2) ** 2
    size = np.sqrt((offsets**2).sum(axis=1).mean())
    J = np.hstack([np.cross(offsets / size, n), n])
    A = (J * weight[:, None]).T @ J
    A += _DAMPING * np.trace(A) * np.eye(6)
    step = np.linalg.solve(A, (J * weight[:, None]).T @ residuals)
    R = Rotation.from_rotvec(step[:3] / size).as_matrix()
    return transforms.rigid(R, center + step[3:] - R @ center)
