# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bilateral normal filtering of a closed mesh of quadrilaterals (Zheng et al. 2011).

The normals of neighbouring faces are averaged where they differ by no more than their noise
lets expect, and the vertices follow them (Sun et al. 2007). A face across an edge of the part
differs by more and has no say, so that the edge stays.
"""

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Normals that differ by so many times their noise have a weight of exp(-1/2).
_ALIKE = 2.5
_LEAST, _MOST = 0.06, 0.5  # radians, of the noise of a normal times _ALIKE
_VERTEX_ROUNDS = 10


def denoised(
    vertices: Floats, quads: Ints, noise: Floats, rounds: int, leash: float = 0.9
) -> Floats:
    """
    Return the vertices moved to where the filtered normals want them.

    vertices : (n, 3); quads : (m, 4), closed and 2-manifold
    noise : (m,) radians, 1 sigma of each face's normal
    leash : how far a vertex may go along each axis
    """
    if not rounds or not len(quads):
        return vertices
    around = neighbours(quads)
    wanted = filtered_normals(quad_normals(vertices, quads), around, noise, rounds)
    return _followed(vertices, quads, wanted, leash)


def neighbours(quads: Ints) -> Ints:
    """Return the (m, 4) quads across each edge of closed 2-manifold quads."""
    following = np.roll(quads, -1, axis=1)
    low, high = np.minimum(quads, following).ravel(), np.maximum(quads, following).ravel()
    order = np.argsort(low * (int(quads.max()) + 1) + high, kind='stable')
    across = np.empty(len(order), dtype=np.int64)
    across[order[0::2]], across[order[1::2]] = order[1::2], order[0::2]
    return np.asarray((across // 4).reshape(-1, 4))


def quad_normals(vertices: Floats, quads: Ints) -> Floats:
    """Return the (m, 3) unit normals: the cross product of the diagonals."""
    a, b, c, d = (vertices[quads[:, k]] for k in range(4))
    across = np.cross(c - a, d - b)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(across / np.maximum(length, 1e-30))


def filtered_normals(normals: Floats, around: Ints, noise: Floats, rounds: int) -> Floats:
    """Return the normals after ``rounds`` of averaging with those around that are alike."""
    limit = np.clip(_ALIKE * noise, _LEAST, _MOST).astype(np.float32)
    sharpness = -0.5 / (limit * limit)
    single = normals.astype(np.float32)
    for _ in range(rounds):
        beside = single[around]
        unlike = 2.0 - 2.0 * np.einsum('mkc,mc->mk', beside, single)
        weight = np.exp(unlike * sharpness[:, None])
        single = single + np.einsum('mk,mkc->mc', weight, beside)
        single /= np.maximum(np.linalg.norm(single, axis=1, keepdims=True), 1e-12)
    return single.astype(np.float64)


def _followed(vertices: Floats, quads: Ints, normals: Floats, leash: float) -> Floats:
    """Move each vertex to the mean of its projections on the planes of its faces."""
    corner = quads.ravel()
    count = len(vertices)
    faces = np.maximum(np.bincount(corner, minlength=count), 1)[:, None]
    moved = vertices.copy()
    for _ in range(_VERTEX_ROUNDS):
        at = moved[quads]
        above = np.einsum('mc,mkc->mk', normals, at.mean(axis=1, keepdims=True) - at).ravel()
        for axis in range(3):
            step = np.bincount(corner, above * np.repeat(normals[:, axis], 4), minlength=count)
            moved[:, axis] += step / faces[:, 0]
        np.clip(moved, vertices - leash, vertices + leash, out=moved)
    return moved
