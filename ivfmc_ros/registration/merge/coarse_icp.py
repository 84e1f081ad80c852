# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Guessed poses settle where the surfaces meet; those that come to the same place are one."""

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.nearest_grid import NearGrid
from ivfmc_ros.registration.merge.point_pair_features import distinct
from ivfmc_ros.registration.merge.point_pair_features import Guesses

# Reaches in steps of the guess, and how often each is used.
_REACHES, _ROUNDS = (2.0, 1.0, 0.5), 8
_POINTS = 1500
_ALIKE = 0.8
# Poses that put no point of the body farther apart than this are one, in steps.
_SAME = 0.4
# What the surface does not hold moves this little, as a share of what it holds best.
_RIDGE = 1e-4
_LEAST_PAIRS = 30


def settle(body: Body, onto: Body, guesses: Guesses) -> Guesses:
    """
    Move every guess to where the body lies best on the other (point to plane).

    returns : distinct poses onto_from_body; their share is of the points within half a step
    """
    rng = np.random.default_rng(0)
    few = body.chosen(rng.permutation(len(body))[:_POINTS])
    poses = guesses.poses
    for reach in _REACHES:
        seat = _Seat(onto, reach * guesses.step)
        found = [seat.settled(few, T) for T in poses]
        poses = np.array([T for T, _ in found]).reshape(-1, 4, 4)
    share = np.array([share for _, share in found])
    chosen = distinct(poses, share, body.patches.points_xyz, _SAME * guesses.step)
    return Guesses(poses=poses[chosen], share=share[chosen], step=guesses.step)


class _Seat:
    def __init__(self, onto: Body, reach: float) -> None:
        self._patches = onto.patches
        self._reach = reach
        self._grid = NearGrid.of(onto.patches.points_xyz, reach / 3, reach)

    def settled(self, body: Body, T: Floats) -> tuple[Floats, float]:
        """Return the pose after a few steps, and the share of points that have a partner."""
        points, normals = body.patches.points_xyz, body.patches.normals
        share = 0.0
        for _ in range(_ROUNDS):
            here, facing = transforms.apply(T, points), normals @ T[:3, :3].T
            j = self._grid.find(here)
            n = facing + self._patches.normals[j]
            alike = (facing * self._patches.normals[j]).sum(axis=1) > _ALIKE
            used = (j >= 0) & alike
            share = float(used.mean())
            if used.sum() < _LEAST_PAIRS:
                break
            n = n[used] / np.linalg.norm(n[used], axis=1, keepdims=True)
            middle = here[used].mean(axis=0)
            gap = ((self._patches.points_xyz[j[used]] - here[used]) * n).sum(axis=1)
            T = _step(here[used] - middle, n, gap, self._reach, middle) @ T
        return T, share


def _step(lever: Floats, n: Floats, gap: Floats, reach: float, middle: Floats) -> Floats:
    """Return the motion about ``middle`` that closes (n,) gaps along the normals."""
    weight = 1.0 / (1.0 + (3.0 * gap / reach) ** 2) ** 2
    size = np.sqrt((lever**2).sum(axis=1).mean())
    J = np.hstack([np.cross(lever / size, n), n])
    A = (J * weight[:, None]).T @ J
    A += _RIDGE * np.trace(A) * np.eye(6)
    step = np.linalg.solve(A, (J * weight[:, None]).T @ gap)
    R = Rotation.from_rotvec(step[:3] / size).as_matrix()
    return transforms.rigid(R, middle + step[3:] - R @ middle)
