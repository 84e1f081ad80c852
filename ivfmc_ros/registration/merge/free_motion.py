# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a surface leaves open: a motion along which a body may slide on another.

A shaft turns in its own surface until a keyway, a hole or a flat catches. A search from far away
finds the shaft and not the keyway; here the free motion is followed all the way, and the places
where it catches are what is returned.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.nearest_grid import NearGrid
from ivfmc_ros.registration.merge.point_pair_features import box_corners
from ivfmc_ros.registration.solver.gauss_newton import Joint
from ivfmc_ros.registration.solver.normal_equations import DOF

# What may move the part by more than this (metres, 1 sigma) is not held by the surface.
HELD = 1e-4
# A step along a free motion, and how near a surface has to be, in patch spacings.
_STEP, _NEAR = 0.5, 1.0
_MOST_STEPS = 2000
# A patch catches where the motion goes into its surface by this share of its way.
_INTO = 0.25
_ALIKE = 0.9
_CATCHES = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Freedom:
    """
    How uncertain the pose of a body is.

    sigma : (6,) metres that each of six independent motions makes over the corners of the box
        around the body (rms), ascending; motions : (6, 6) these in columns (rotation vector,
        translation), of a metre each
    """

    sigma: Floats
    motions: Floats

    @property
    def free(self) -> Floats:
        """(k, 6) motions that the surface does not hold."""
        return np.asarray(self.motions.T[self.sigma > HELD])

    def held(self, sigma: float) -> 'Freedom':
        """Return the same, but what was free is known to ``sigma`` metres by something else."""
        return replace(self, sigma=np.where(self.sigma > HELD, sigma, self.sigma))


def freedom_of(joint: Joint, view: int, body: Body) -> Freedom:
    """Return what a solution leaves open of the pose of one body, which lies where it found it."""
    own = slice(DOF * view, DOF * (view + 1))
    corners = box_corners(body.patches.points_xyz)
    # rows: how a corner moves with the motion
    cross = np.array([[[0, z, -y], [-z, 0, x], [y, -x, 0]] for x, y, z in corners])
    J = np.concatenate([cross, np.tile(np.eye(3), (len(corners), 1, 1))], axis=2)
    metric = np.einsum('kci,kcj->ij', J, J) / len(corners)
    L = np.linalg.cholesky(metric)
    level, axes = np.linalg.eigh(L.T @ joint.solution.covariance[own, own] @ L)
    return Freedom(sigma=np.sqrt(np.maximum(level, 0.0)), motions=np.linalg.solve(L.T, axes))


def along(motion: Floats, body: Body, step: float) -> Floats:
    """
    Return motions (k, 4, 4) that follow a (6,) free one, a whole turn or the body's length.

    step : metres, by which the corners of the body move from one to the next
    """
    turn, shift = motion[:3], motion[3:]
    rate = float(np.linalg.norm(turn))
    size = float(np.linalg.norm(np.ptp(body.patches.points_xyz, axis=0)))
    # a motion moves the corners by a metre
    if rate * size < 0.1 * float(np.linalg.norm(shift)):
        way = np.arange(-size, size, max(step, 2.0 * size / _MOST_STEPS))
        return np.array([transforms.rigid(np.eye(3), t * shift) for t in way])
    count = int(np.clip(2.0 * np.pi / rate / step, 12, _MOST_STEPS))
    angle = 2.0 * np.pi * np.arange(count) / count
    axis = turn / rate
    point = np.cross(turn, shift) / rate**2
    R = Rotation.from_rotvec(angle[:, None] * axis).as_matrix()
    pitch = float(axis @ shift) / rate
    # a screw would not come back to where it began
    return np.array(
        [transforms.rigid(r, point - r @ point) for r in R] if abs(pitch) < size else [np.eye(4)]
    )


def catches(body: Body, onto: Body, motion: Floats, edge: float) -> Floats:
    """
    Return motions (k, 4, 4) along a free one at which surface meets surface that would stop it.

    body : where it lies on ``onto``
    """
    points, normals = body.patches.points_xyz, body.patches.normals
    velocity = np.cross(motion[:3], points) + motion[3:]
    into = np.abs((velocity * normals).sum(axis=1))
    stops = np.flatnonzero(into > _INTO * np.linalg.norm(velocity, axis=1))
    path = along(motion, body, _STEP * edge)
    if not len(stops) or len(path) < 3:
        return np.empty((0, 4, 4))
    grid = NearGrid.of(onto.patches.points_xyz, edge / 2, _NEAR * edge)
    caught = np.array([_meeting(body.chosen(stops).moved(T), onto, grid, edge) for T in path])
    usual = np.median(caught)
    level = usual + 5.0 * np.sqrt(usual + 1.0)
    # round the path; scipy.signal would find them too, and takes half a second to import
    peaks = (caught > np.roll(caught, 1)) & (caught >= np.roll(caught, -1))
    best = np.flatnonzero(peaks & (caught >= level))
    best = best[np.argsort(-caught[best], kind='stable')][:_CATCHES]
    return np.asarray(path[best])


def _meeting(body: Body, onto: Body, grid: NearGrid, edge: float) -> int:
    """Return how many patches lie on the other's surface."""
    j = grid.find(body.patches.points_xyz)
    facing = onto.patches.normals[j]
    gap = ((body.patches.points_xyz - onto.patches.points_xyz[j]) * facing).sum(axis=1)
    alike = (body.patches.normals * facing).sum(axis=1) > _ALIKE
    return int(np.count_nonzero((j >= 0) & alike & (np.abs(gap) < 0.5 * edge)))
