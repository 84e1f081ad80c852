# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many points of a scan are off by more than their stated uncertainty."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.surface import Surface

# Coverage factor of the expanded uncertainty U = k u (GUM 6.2.1).
_COVERAGE = 2.0
_ITERATIONS = 6
# Points with which all rotations are tried, the tolerance for half a degree at a radius of 20 mm,
# meters, and the number of rotations that are fitted.
_SEARCHED, _SEARCH_TOLERANCE, _TURNS = 1500, 1.7e-4, 3


def share_off(
    points: Floats, sigma: Floats, part: Solid, turns: Sequence[float] = (0.0,)
) -> float:
    """
    Return the share of points farther from the part than their expanded uncertainty.

    The shape is what counts: the points are fitted to the part as a rigid body before.

    points, sigma : (n, 3) and (n,) meters
    turns : rotations about the axis, radians, from which the fit begins; the best one counts
    """
    surface = Surface(part.vertices_xyz, part.faces)
    shares = []
    for turn in turns:
        fitted = _best_fit(points @ transforms.rotation_z(turn).T, sigma, surface)
        off = np.abs(surface.signed_distance(fitted)) > _COVERAGE * sigma
        shares.append(float(off.mean()))
    return min(shares)


def likely_turns(points: Floats, sigma: Floats, part: Solid) -> list[float]:
    """
    Return rotations about the axis, radians, at which the most points lie on the part.

    points, sigma : as for ``share_off``
    """
    surface = Surface(part.vertices_xyz, part.faces)
    some = slice(None, None, max(1, len(points) // _SEARCHED))
    turns = np.radians(np.arange(-180.0, 180.0))
    turned = np.stack([points[some] @ transforms.rotation_z(turn).T for turn in turns])
    off = np.abs(surface.signed_distance(turned.reshape(-1, 3))).reshape(len(turns), -1)
    share = (off > _COVERAGE * sigma[some] + _SEARCH_TOLERANCE).mean(axis=1)
    return [float(turn) for turn in turns[np.argsort(share)[:_TURNS]]]


def _best_fit(points: Floats, sigma: Floats, surface: Surface) -> Floats:
    """Return the points moved onto a surface, weighted by sigma; some may be far off (Tukey)."""
    for _ in range(_ITERATIONS):
        near = surface.nearest(points)
        off = ((points - near.points_xyz) * near.normals).sum(axis=1) / sigma
        scale = max(3.0, 3.0 * 1.4826 * float(np.median(np.abs(off))))
        weight = np.clip(1.0 - (off / scale) ** 2, 0.0, None)
        arms = np.cross(points, near.normals)
        J = np.hstack([arms, near.normals]) * (weight / sigma)[:, None]
        normal = J.T @ J
        # a ridge, because a round part may turn freely
        normal += np.diag(1e-6 * np.diag(normal) + 1e-12 * np.trace(normal))
        step = np.linalg.solve(normal, -J.T @ (weight * off))
        T = transforms.rigid(Rotation.from_rotvec(step[:3]).as_matrix(), step[3:])
        points = transforms.apply(T, points)
    return points
