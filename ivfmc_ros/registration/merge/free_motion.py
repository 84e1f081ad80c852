# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Unconstrained motions of a registered surface, and the places along them that constrain it.

A shaft may rotate in its own surface until a keyway, a hole or a flat stops it (slippable
motions: Gelfand and Guibas 2004). The global search finds the shaft and misses the small
keyway. Here the unconstrained motion is followed all the way, and the poses where small surfaces
meet their counterparts are returned.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.nearest_grid import NearestGrid
from ivfmc_ros.registration.merge.point_pair_features import box_corners
from ivfmc_ros.registration.solver.gauss_newton import RegistrationResult
from ivfmc_ros.registration.solver.normal_equations import DOF

# A motion whose standard deviation displaces the part by more (meters) is unconstrained: merged
# parts must agree within 0.1 mm.
MAX_SIGMA = 1e-4
# Step along a motion, and greatest distance of corresponding surfels, in surfel spacings.
_STEP, _SEARCH_RADIUS = 0.5, 1.0
_MAX_STEPS = 2000
# A surfel opposes a motion if this fraction of its displacement is along the normal.
_OPPOSING = 0.25
# Least cosine between the normals of corresponding surfels.
_MIN_COSINE = 0.9
# Poses that are returned at most, the best first.
_MAX_POSES = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseUncertainty:
    """
    Uncertainty of a pose along six independent motions.

    sigma : (6,) meters, rms displacement of the corners of the surface's bounding box by 1 sigma
        of each motion, ascending
    motions : (6, 6) the motions in columns (rotation vector, translation), each of which
        displaces the corners by one meter (rms)
    """

    sigma: Floats
    motions: Floats

    @property
    def unconstrained(self) -> Floats:
        """(k, 6) motions that the surface does not constrain."""
        return np.asarray(self.motions.T[self.sigma > MAX_SIGMA])

    def constrained(self, sigma: float) -> 'PoseUncertainty':
        """Return the same with ``sigma`` meters for all unconstrained motions."""
        return replace(self, sigma=np.where(self.sigma > MAX_SIGMA, sigma, self.sigma))


def pose_uncertainty(
    result: RegistrationResult, view: int, surface: ClampedSurface
) -> PoseUncertainty:
    """
    Return the uncertainty of one pose of a registration.

    view : index of the pose
    surface : transformed by that pose
    """
    own = slice(DOF * view, DOF * (view + 1))
    corners = box_corners(surface.surfels.points_xyz)
    # Jacobian of the corners by rotation vector and translation
    cross = np.array([[[0, z, -y], [-z, 0, x], [y, -x, 0]] for x, y, z in corners])
    J = np.concatenate([cross, np.tile(np.eye(3), (len(corners), 1, 1))], axis=2)
    metric = np.einsum('kci,kcj->ij', J, J) / len(corners)
    L = np.linalg.cholesky(metric)
    variances, axes = np.linalg.eigh(L.T @ result.solution.covariance[own, own] @ L)
    return PoseUncertainty(
        sigma=np.sqrt(np.maximum(variances, 0.0)), motions=np.linalg.solve(L.T, axes)
    )


def sample_motion(motion: Floats, surface: ClampedSurface, step: float) -> Floats:
    """
    Return poses (k, 4, 4) along a motion: a whole turn, or shifts by the surface's length.

    motion : (6,) rotation vector and translation that displace the surface by one meter (rms)
    step : meters, displacement of the surface's corners from one pose to the next
    """
    rotation, translation = motion[:3], motion[3:]
    rate = float(np.linalg.norm(rotation))
    size = float(np.linalg.norm(np.ptp(surface.surfels.points_xyz, axis=0)))
    if rate * size < 0.1 * float(np.linalg.norm(translation)):
        amounts = np.arange(-size, size, max(step, 2.0 * size / _MAX_STEPS))
        return np.array([transforms.rigid(np.eye(3), t * translation) for t in amounts])
    count = int(np.clip(2.0 * np.pi / rate / step, 12, _MAX_STEPS))
    angles = 2.0 * np.pi * np.arange(count) / count
    axis = rotation / rate
    point = np.cross(rotation, translation) / rate**2
    R = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
    pitch = float(axis @ translation) / rate
    if abs(pitch) >= size:
        # a screw does not return to its start after a turn; it is not followed
        return np.eye(4)[None]
    return np.array([transforms.rigid(r, point - r @ point) for r in R])


def constraining_poses(
    surface: ClampedSurface, target: ClampedSurface, motion: Floats, spacing: float
) -> Floats:
    """
    Return poses (k, 4, 4) along a motion at which opposing surfels meet their counterparts.

    surface : registered to ``target``
    motion : (6,) unconstrained, as of ``PoseUncertainty``
    spacing : of the surfels, meters
    """
    points, normals = surface.surfels.points_xyz, surface.surfels.normals
    velocity = np.cross(motion[:3], points) + motion[3:]
    along_normal = np.abs((velocity * normals).sum(axis=1))
    opposing = np.flatnonzero(along_normal > _OPPOSING * np.linalg.norm(velocity, axis=1))
    path = sample_motion(motion, surface, _STEP * spacing)
    if not len(opposing) or len(path) < 3:
        return np.empty((0, 4, 4))
    grid = NearestGrid.build(target.surfels.points_xyz, spacing / 2, _SEARCH_RADIUS * spacing)
    obstacles = surface.selected(opposing)
    counts = np.array(
        [_count_contacts(obstacles.transformed(T), target, grid, spacing) for T in path]
    )
    # five standard deviations of a Poisson count above the usual number of contacts
    median = np.median(counts)
    threshold = median + 5.0 * np.sqrt(median + 1.0)
    # cyclic; scipy.signal.find_peaks is not, and takes half a second to import
    peaks = (counts > np.roll(counts, 1)) & (counts >= np.roll(counts, -1))
    best = np.flatnonzero(peaks & (counts >= threshold))
    best = best[np.argsort(-counts[best], kind='stable')][:_MAX_POSES]
    return np.asarray(path[best])


def _count_contacts(
    surface: ClampedSurface, target: ClampedSurface, grid: NearestGrid, spacing: float
) -> int:
    """Return how many surfels lie on the target's surface."""
    j = grid.query(surface.surfels.points_xyz)
    target_normals = target.surfels.normals[j]
    offset = surface.surfels.points_xyz - target.surfels.points_xyz[j]
    residuals = (offset * target_normals).sum(axis=1)
    compatible = (surface.surfels.normals * target_normals).sum(axis=1) > _MIN_COSINE
    return int(np.count_nonzero((j >= 0) & compatible & (np.abs(residuals) < 0.5 * spacing)))
