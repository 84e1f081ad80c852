# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bilateral normal filtering of a closed quadrilateral mesh (Zheng et al. 2011).

The normals of neighboring faces are averaged, weighted by how much they differ in units of their
noise; then the vertices are moved so that the faces match the filtered normals (Sun et al. 2007).
A face across an edge of the part differs by more than noise and has almost no weight, so that
edges stay sharp.
"""

import numpy as np

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.geometry.normals import cross
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles

# Width of the range kernel in 1 sigma of a normal: at this difference the weight is exp(-1/2).
_RANGE_SIGMAS = 2.5
# Limits of the width of the range kernel, radians.
_MIN_RANGE, _MAX_RANGE = 0.06, 0.5
_VERTEX_ITERATIONS = 5
_MAX_UNFOLD_ITERATIONS = 10
_CHUNK = 1 << 14  # quads


def denoise_quads(
    vertices: Floats, quads: Ints, noise: Floats, iterations: int, max_shift: float = 0.9
) -> Floats:
    """
    Return the vertices after bilateral filtering of the face normals.

    vertices : (n, 3) float64, any unit
    quads : (m, 4) int64, closed and 2-manifold
    noise : (m,) radians, 1 sigma of the normal of each face
    iterations : rounds of normal filtering; 0 returns the given vertices
    max_shift : greatest shift of a vertex along each axis, in the unit of ``vertices``
    """
    if not iterations or not len(quads):
        return vertices
    neighbors = quad_neighbors(quads)
    filtered = filter_normals(quad_normals(vertices, quads), neighbors, noise, iterations)
    return unfold(vertices, _fit_vertices(vertices, quads, filtered, max_shift), quads)


def quad_neighbors(quads: Ints) -> Ints:
    """Return (m, 4) int64, the quad across each edge of closed 2-manifold quads."""
    order = topology.edge_order(quads)
    across = np.empty(len(order), dtype=np.int64)
    across[order[0::2]], across[order[1::2]] = order[1::2], order[0::2]
    return np.asarray((across // 4).reshape(-1, 4))


def quad_normals(vertices: Floats, quads: Ints) -> Floats:
    """Return the (m, 3) unit normals of quads: the cross product of their diagonals."""
    found = np.empty((len(quads), 3))

    def compute(chunk: slice) -> None:
        a, b, c, d = (vertices.take(column, axis=0).T for column in quads[chunk].T)
        area = cross(c - a, d - b)
        found[chunk] = (area / np.maximum(np.linalg.norm(area, axis=0), 1e-30)).T

    run_chunked(compute, len(quads), _CHUNK)
    return found


def filter_normals(normals: Floats, neighbors: Ints, noise: Floats, iterations: int) -> Singles:
    """
    Return the normals after ``iterations`` of the bilateral mean over the four neighbors.

    normals : (m, 3) unit
    neighbors : (m, 4) int64, from ``quad_neighbors``
    noise : (m,) radians, 1 sigma of each normal
    returns : (m, 3) float32, unit
    """
    width = np.clip(_RANGE_SIGMAS * noise, _MIN_RANGE, _MAX_RANGE).astype(np.float32)
    exponent = -0.5 / (width * width)
    # one array for each of x, y, z, and for each side of the quads: contiguous in memory
    single = np.ascontiguousarray(normals.T, dtype=np.float32)
    after = np.empty_like(single)
    sides = np.ascontiguousarray(neighbors.T)

    def average(chunk: slice) -> None:
        x, y, z = own = single[:, chunk]
        a, b, c = others = [row.take(sides[:, chunk]) for row in single]
        weight = np.exp((2.0 - 2.0 * (a * x + b * y + c * z)) * exponent[chunk])
        mean = own + np.stack([(weight * row).sum(axis=0) for row in others])
        after[:, chunk] = mean / np.maximum(np.sqrt((mean * mean).sum(axis=0)), 1e-12)

    for _ in range(iterations):
        run_chunked(average, len(normals), _CHUNK)
        single, after = after, single
    return np.ascontiguousarray(single.T)


def _fit_vertices(vertices: Floats, quads: Ints, normals: Singles, max_shift: float) -> Floats:
    """Move each vertex to the mean of its projections on the planes of its faces."""
    count = len(vertices)
    summing = topology.face_to_vertex_sum(quads, count, np.float32)
    faces = np.maximum(np.bincount(quads.ravel(), minlength=count), 1).astype(np.float32)
    # the sum of n (n.(c - v)) over faces is that of n (n.c), less that of n n^T times v
    x, y, z = normals.T
    squares = summing @ np.stack([x * x, y * y, z * z, x * y, y * z, z * x], axis=1)
    start = vertices.astype(np.float32)
    moved = start.copy()
    for _ in range(_VERTEX_ITERATIONS):
        total = summing @ _center_projections(moved, quads, normals)

        def move(chunk: slice, total: Singles = total) -> None:
            offset = total[chunk].T - _symmetric_product(squares[chunk].T, moved[chunk].T)
            step = offset / faces[chunk]
            target, origin = moved[chunk] + step.T, start[chunk]
            np.clip(target, origin - max_shift, origin + max_shift, out=moved[chunk])

        run_chunked(move, count, _CHUNK)
    return np.asarray(moved, dtype=np.float64)


def unfold(start: Floats, moved: Floats, quads: Ints) -> Floats:
    """
    Return ``moved``, with the vertices of folded quads put back to ``start`` until none is folded.

    start, moved : (n, 3) vertices before and after denoising
    quads : (m, 4) int64
    """
    before = quad_normals(start, quads)
    moved = moved.copy()
    for _ in range(_MAX_UNFOLD_ITERATIONS):
        folded = _folded(moved, quads, before)
        if not folded.any():
            break
        back = np.unique(quads[folded])
        if (moved[back] == start[back]).all():
            break
        moved[back] = start[back]
    return moved


def _folded(vertices: Floats, quads: Ints, normals: Floats) -> Bools:
    """Return (m,) bool, which quads have a corner that faces against the given normal."""
    single = vertices.astype(np.float32)
    folded = np.empty(len(quads), dtype=bool)

    def check(chunk: slice) -> None:
        folded[chunk] = _has_folded_corner(single.take(quads[chunk].T, axis=0), normals[chunk])

    run_chunked(check, len(quads), _CHUNK)
    return folded


def _has_folded_corner(corners_xyz: Singles, normals: Floats) -> Bools:
    """Return (m,) bool for (4, m, 3) corners of quads."""
    nx, ny, nz = np.ascontiguousarray(normals.T, dtype=np.float32)
    corners = np.ascontiguousarray(np.moveaxis(corners_xyz, 2, 1))
    sides = np.roll(corners, -1, axis=0) - corners
    folded = np.zeros(len(normals), dtype=bool)
    for (ax, ay, az), (bx, by, bz) in zip(np.roll(sides, 1, axis=0), sides, strict=True):
        facing = (ay * bz - az * by) * nx + (az * bx - ax * bz) * ny + (ax * by - ay * bx) * nz
        folded |= facing < 0.0
    return folded


def _center_projections(vertices: Singles, quads: Ints, normals: Singles) -> Singles:
    """Return (m, 3) n (n.c) of each quad with normal n and center c."""
    projections = np.empty_like(normals)

    def project(chunk: slice) -> None:
        normal = normals[chunk]
        a, b, c, d = (vertices.take(column, axis=0) for column in quads[chunk].T)
        height = np.float32(0.25) * np.einsum('mc,mc->m', normal, a + b + c + d)
        projections[chunk] = height[:, None] * normal

    run_chunked(project, len(quads), _CHUNK)
    return projections


def _symmetric_product(squares: Singles, vectors: Singles) -> Singles:
    """Multiply (3, n) vectors by symmetric matrices (6, n): xx, yy, zz, xy, yz, zx."""
    xx, yy, zz, xy, yz, zx = squares
    x, y, z = np.ascontiguousarray(vectors)
    return np.stack([xx * x + xy * y + zx * z, xy * x + yy * y + yz * z, zx * x + yz * y + zz * z])
