# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bilateral normal filtering of a closed mesh of quadrilaterals (Zheng et al. 2011).

The normals of neighbouring faces are averaged where they differ by no more than their noise
lets expect, and the vertices follow them (Sun et al. 2007). A face across an edge of the part
differs by more and has no say, so that the edge stays.
"""

import numpy as np

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.geometry.normals import cross
from ivfmc_ros.meshing.parallel import in_parts
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
    found = np.empty((len(quads), 3))

    def compute(some: slice) -> None:
        a, b, c, d = (vertices.take(column, axis=0).T for column in quads[some].T)
        across = cross(c - a, d - b)
        found[some] = (across / np.maximum(np.linalg.norm(across, axis=0), 1e-30)).T

    in_parts(compute, len(quads), _AT_ONCE)
    return found


def filtered_normals(normals: Floats, around: Ints, noise: Floats, rounds: int) -> Singles:
    """Return the normals after ``rounds`` of averaging with those around that are alike."""
    limit = np.clip(_ALIKE * noise, _LEAST, _MOST).astype(np.float32)
    sharpness = -0.5 / (limit * limit)
    # one array for each of x, y, z, and for each side of the quads: all runs along memory
    single = np.ascontiguousarray(normals.T, dtype=np.float32)
    after = np.empty_like(single)
    sides = np.ascontiguousarray(around.T)

    def average(some: slice) -> None:
        x, y, z = own = single[:, some]
        a, b, c = beside = [row.take(sides[:, some]) for row in single]
        weight = np.exp((2.0 - 2.0 * (a * x + b * y + c * z)) * sharpness[some])
        mean = own + np.stack([(weight * row).sum(axis=0) for row in beside])
        after[:, some] = mean / np.maximum(np.sqrt((mean * mean).sum(axis=0)), 1e-12)

    for _ in range(rounds):
        in_parts(average, len(normals), _AT_ONCE)
        single, after = after, single
    return np.ascontiguousarray(single.T)


def _followed(vertices: Floats, quads: Ints, normals: Singles, leash: float) -> Floats:
    """Move each vertex to the mean of its projections on the planes of its faces."""
    count = len(vertices)
    adding = topology.adding(quads, count, np.float32)
    faces = np.maximum(np.bincount(quads.ravel(), minlength=count), 1).astype(np.float32)
    # the sum of n (n.(c - v)) over faces is that of n (n.c), less that of n n^T times v
    x, y, z = normals.T
    squares = adding @ np.stack([x * x, y * y, z * z, x * y, y * z, z * x], axis=1)
    start = vertices.astype(np.float32)
    moved = start.copy()
    for _ in range(_VERTEX_ROUNDS):
        total = adding @ _pushed(moved, quads, normals)

        def move(some: slice, total: Singles = total) -> None:
            step = (total[some].T - _times(squares[some].T, moved[some].T)) / faces[some]
            there, leashed = moved[some] + step.T, start[some]
            np.clip(there, leashed - leash, leashed + leash, out=moved[some])

        in_parts(move, count, _AT_ONCE)
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
    folded = np.empty(len(quads), dtype=bool)

    def look(some: slice) -> None:
        folded[some] = _folded_of(single.take(quads[some].T, axis=0), normals[some])

    in_parts(look, len(quads), _AT_ONCE)
    return folded


def _folded_of(corners_xyz: Singles, normals: Floats) -> Bools:
    nx, ny, nz = np.ascontiguousarray(normals.T, dtype=np.float32)
    corners = np.ascontiguousarray(np.moveaxis(corners_xyz, 2, 1))
    sides = np.roll(corners, -1, axis=0) - corners
    folded = np.zeros(len(normals), dtype=bool)
    for (ax, ay, az), (bx, by, bz) in zip(np.roll(sides, 1, axis=0), sides, strict=True):
        across = (ay * bz - az * by) * nx + (az * bx - ax * bz) * ny + (ax * by - ay * bx) * nz
        folded |= across < 0.0
    return folded


def _pushed(vertices: Singles, quads: Ints, normals: Singles) -> Singles:
    """Return (m, 3) the normals, as long as the middles of the quads are high along them."""
    pushed = np.empty_like(normals)

    def push(some: slice) -> None:
        normal = normals[some]
        a, b, c, d = (vertices.take(column, axis=0) for column in quads[some].T)
        height = np.float32(0.25) * np.einsum('mc,mc->m', normal, a + b + c + d)
        pushed[some] = height[:, None] * normal

    in_parts(push, len(quads), _AT_ONCE)
    return pushed


def _times(squares: Singles, vectors: Singles) -> Singles:
    """Multiply (3, n) vectors by symmetric matrices (6, n): xx, yy, zz, xy, yz, zx."""
    xx, yy, zz, xy, yz, zx = squares
    x, y, z = np.ascontiguousarray(vectors)
    return np.stack([xx * x + xy * y + zx * z, xy * x + yy * y + yz * z, zx * x + yz * y + zz * z])
