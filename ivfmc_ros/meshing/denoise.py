# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bilateral normal filtering of a closed mesh of quadrilaterals (Zheng et al. 2011).

The normals of neighbouring faces are averaged where they differ by no more than their noise
lets expect, and the vertices follow them (Sun et al. 2007). A face across an edge of the part
differs by more and has no say, so that the edge stays.
"""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

# Normals that differ by so many times their noise have a weight of exp(-1/2).
_ALIKE = 2.5
_LEAST, _MOST = 0.06, 0.5  # radians, of the noise of a normal times _ALIKE
_VERTEX_ROUNDS = 5
_AT_ONCE = 1 << 14  # quads
_UNFOLDING_ROUNDS = 10


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
    return unfolded(vertices, _followed(vertices, quads, wanted, leash), quads)


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


def filtered_normals(normals: Floats, around: Ints, noise: Floats, rounds: int) -> Singles:
    """Return the normals after ``rounds`` of averaging with those around that are alike."""
    limit = np.clip(_ALIKE * noise, _LEAST, _MOST).astype(np.float32)
    sharpness = -0.5 / (limit * limit)
    single = normals.astype(np.float32)
    for _ in range(rounds):
        after = np.empty_like(single)
        for some in _portions(len(single)):
            own, beside = single[some], single[around[some]]
            unlike = 2.0 - 2.0 * np.einsum('mkc,mc->mk', beside, own)
            weight = np.exp(unlike * sharpness[some, None])
            mean = own + np.einsum('mk,mkc->mc', weight, beside)
            length = np.sqrt(np.einsum('mc,mc->m', mean, mean))
            after[some] = mean / np.maximum(length, 1e-12)[:, None]
        single = after
    return single


def _portions(count: int) -> Iterator[slice]:
    """Give all of an array in parts that stay in the processor's cache."""
    for start in range(0, count, _AT_ONCE):
        yield slice(start, start + _AT_ONCE)


def _followed(vertices: Floats, quads: Ints, normals: Singles, leash: float) -> Floats:
    """Move each vertex to the mean of its projections on the planes of its faces."""
    count = len(vertices)
    # row v has a one for each face at vertex v
    at_vertex = csr_array(
        (
            np.ones(quads.size, dtype=np.float32),
            (quads.ravel(), np.repeat(np.arange(len(quads)), 4)),
        ),
        shape=(count, len(quads)),
    )
    faces = np.maximum(at_vertex @ np.ones(len(quads), dtype=np.float32), 1.0)[:, None]
    # the sum of n (n.(c - v)) over faces is that of n (n.c), less that of n n^T times v
    x, y, z = normals.T
    squares = at_vertex @ np.stack([x * x, y * y, z * z, x * y, y * z, z * x], axis=1)
    start = vertices.astype(np.float32)
    moved = start
    for _ in range(_VERTEX_ROUNDS):
        pushed = _pushed(moved, quads, normals)
        moved = moved + (at_vertex @ pushed - _times(squares, moved)) / faces
        np.clip(moved, start - leash, start + leash, out=moved)
    return np.asarray(moved, dtype=np.float64)


def unfolded(start: Floats, moved: Floats, quads: Ints) -> Floats:
    """Put vertices back around quads that moving folded, until none is."""
    before = quad_normals(start, quads)
    moved = moved.copy()
    for _ in range(_UNFOLDING_ROUNDS):
        folded = _folded(moved, quads, before)
        if not folded.any():
            break
        back = np.unique(quads[folded])
        if (moved[back] == start[back]).all():
            break
        moved[back] = start[back]
    return moved


def _folded(vertices: Floats, quads: Ints, normals: Floats) -> Bools:
    """Tell of which quads a corner looks away from the normal that is given for it."""
    single = vertices.astype(np.float32)
    parts = [_folded_of(single[quads[some]], normals[some]) for some in _portions(len(quads))]
    return np.concatenate(parts)


def _folded_of(corners_xyz: Singles, normals: Floats) -> Bools:
    nx, ny, nz = np.ascontiguousarray(normals.T, dtype=np.float32)
    corners = np.moveaxis(corners_xyz, 0, 2)
    sides = [
        (b[0] - a[0], b[1] - a[1], b[2] - a[2])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    folded = np.zeros(len(normals), dtype=bool)
    for (ax, ay, az), (bx, by, bz) in zip([sides[-1], *sides[:-1]], sides, strict=True):
        across = (ay * bz - az * by) * nx + (az * bx - ax * bz) * ny + (ax * by - ay * bx) * nz
        folded |= across < 0.0
    return folded


def _pushed(vertices: Singles, quads: Ints, normals: Singles) -> Singles:
    """Return (m, 3) the normals, as long as the middles of the quads are high along them."""
    pushed = np.empty_like(normals)
    for some in _portions(len(quads)):
        normal = normals[some]
        a, b, c, d = (vertices[column] for column in quads[some].T)
        height = np.float32(0.25) * np.einsum('mc,mc->m', normal, a + b + c + d)
        pushed[some] = height[:, None] * normal
    return pushed


def _times(squares: Singles, vectors: Singles) -> Singles:
    """Multiply (n, 3) vectors by symmetric matrices (n, 6): xx, yy, zz, xy, yz, zx."""
    xx, yy, zz, xy, yz, zx = squares.T
    x, y, z = vectors.T
    return np.stack(
        [xx * x + xy * y + zx * z, xy * x + yy * y + yz * z, zx * x + yz * y + zz * z], 1
    )
