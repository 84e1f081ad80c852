# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Connectivity of polygon meshes: connected components, boundary loops, bow-tie vertices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import coo_array
from scipy.sparse import csc_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Removing a fan of faces can pinch a neighboring vertex; the removal is repeated this often.
_MAX_BOW_TIE_ITERATIONS = 20
_MAX_INT64 = float(np.iinfo(np.int64).max)


@dataclass(frozen=True, kw_only=True)
class BoundaryLoop:
    """
    A closed chain of boundary edges: a hole or the outer border of an open mesh.

    edges : number of edges
    length : meters
    center_xyz : meters, mean of its vertices
    """

    edges: int
    length: float
    center_xyz: tuple[float, float, float]


def face_to_vertex_sum(faces: Ints, vertices: int, dtype: DTypeLike = np.float64) -> csc_array:
    """
    Return the sparse matrix that sums values of faces at their vertices.

    faces : (m, k) int64, vertex indices
    vertices : number of vertices
    returns : (vertices, m), one where a face uses a vertex
    """
    corners = faces.shape[1]
    return csc_array(
        (
            np.ones(faces.size, dtype=dtype),
            faces.ravel(),
            np.arange(0, faces.size + 1, corners),
        ),
        shape=(vertices, len(faces)),
    )


def face_components(faces: Ints, vertices: int) -> Ints:
    """
    Label the connected components of a mesh; faces that share a vertex are connected.

    faces : (m, k) int64; vertices : number of vertices
    returns : (m,) int64, label of the component of each face
    """
    first = np.repeat(faces[:, 0], faces.shape[1] - 1)
    graph = coo_array(
        (np.ones(len(first), dtype=np.int8), (first, faces[:, 1:].ravel())),
        shape=(vertices, vertices),
    )
    _, label = connected_components(graph, directed=False)
    return np.asarray(label[faces[:, 0]], dtype=np.int64)


def boundary_edges(faces: Ints) -> Ints:
    """Return the (n, 2) directed edges that belong to exactly one of the (m, k) faces."""
    count = int(faces.max(initial=0)) + 1
    first, second = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(first, second), np.maximum(first, second)
    # the direction is the lowest bit: sorting values is much faster than sorting indices
    key = np.sort(2 * (low * count + high) + (first > second))
    edge = key >> 1
    differs = edge[1:] != edge[:-1]
    alone = np.append(True, differs) & np.append(differs, True)
    low, high = np.divmod(edge[alone[: len(edge)]], count)
    backward = (key[alone[: len(key)]] & 1)[:, None] == 1
    ends = np.stack([low, high], axis=1)
    return np.asarray(np.where(backward, ends[:, ::-1], ends))


def edge_order(faces: Ints) -> Ints:
    """
    Return the corners of (m, k) faces in an order in which equal edges follow each other.

    Corner j of face i is number k i + j, and its edge leads to the next corner. Of equal edges,
    the one with the lower number comes first.

    returns : (m k,) int64
    """
    following = np.roll(faces, -1, axis=1)
    low, high = np.minimum(faces, following).ravel(), np.maximum(faces, following).ravel()
    count = int(faces.max(initial=0)) + 1
    key = low * count + high
    if float(count) ** 2 * key.size < _MAX_INT64:
        # sorting values is much faster than sorting indices
        return np.asarray(np.sort(key * key.size + np.arange(key.size)) % key.size)
    return np.asarray(np.argsort(key, kind='stable'))


def boundary_loops(vertices_xyz: Floats, faces: Ints) -> list[BoundaryLoop]:
    """
    Return the boundary loops of a mesh, the longest first.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, k) int64
    """
    edges = boundary_edges(faces)
    if not len(edges):
        return []
    used, local = np.unique(edges, return_inverse=True)
    local = local.reshape(-1, 2)
    graph = coo_array((np.ones(len(local)), (local[:, 0], local[:, 1])), shape=(len(used),) * 2)
    count, label = connected_components(graph, directed=False)
    loop = label[local[:, 0]]
    length = np.linalg.norm(vertices_xyz[edges[:, 0]] - vertices_xyz[edges[:, 1]], axis=1)
    number = np.bincount(loop, minlength=count)
    total = np.bincount(loop, length, minlength=count)
    start = vertices_xyz[edges[:, 0]]
    center = np.stack([np.bincount(loop, start[:, k], count) / number for k in range(3)], axis=1)
    return [
        BoundaryLoop(
            edges=int(number[k]),
            length=float(total[k]),
            center_xyz=(float(center[k, 0]), float(center[k, 1]), float(center[k, 2])),
        )
        for k in np.argsort(-total)
    ]


def faces_without_bow_ties(faces: Ints, vertices: int) -> Bools:
    """
    Return which faces to keep so that no vertex is a bow tie, where two fans of faces meet.

    Of the fans at a bow-tie vertex the largest is kept.

    faces : (m, k) int64, of a 2-manifold from which faces may have been removed
    vertices : number of vertices
    returns : (m,) bool
    """
    keep = np.ones(len(faces), dtype=bool)
    for _ in range(_MAX_BOW_TIE_ITERATIONS):
        chosen = np.flatnonzero(keep)
        removed = _in_smaller_fan(faces[chosen], vertices)
        if not removed.any():
            break
        keep[chosen[removed]] = False
    return keep


def _in_smaller_fan(faces: Ints, vertices: int) -> Bools:
    """Return (m,) bool, which faces are not in the largest fan of one of their vertices."""
    edges = boundary_edges(faces)
    ends = np.bincount(edges.ravel(), minlength=vertices)
    # one fan has two boundary edges at its vertex
    bow_tie = ends > 2
    smaller = np.zeros(len(faces), dtype=bool)
    around = np.flatnonzero(bow_tie[faces].any(axis=1))
    for vertex in np.unique(faces[around][bow_tie[faces[around]]]).tolist():
        fan = around[(faces[around] == vertex).any(axis=1)]
        label = _fan_labels(faces[fan], vertex)
        smaller[fan[label != np.bincount(label).argmax()]] = True
    return smaller


def _fan_labels(faces: Ints, vertex: int) -> Ints:
    """Label the fans of the faces around a vertex: faces of a fan share an edge at it."""
    at = np.argmax(faces == vertex, axis=1)
    rows = np.arange(len(faces))
    sides = faces.shape[1]
    after, before = faces[rows, (at + 1) % sides], faces[rows, (at - 1) % sides]
    linked = (after[:, None] == before[None]) | (before[:, None] == after[None])
    _, label = connected_components(coo_array(linked), directed=False)
    return np.asarray(label, dtype=np.int64)


def compact_vertices(faces: Ints, vertices: int) -> tuple[Ints, Ints]:
    """
    Remove unused vertices.

    faces : (m, k) int64; vertices : number of vertices
    returns : (n,) indices of the vertices that faces use, and the (m, k) faces over these
    """
    used = np.zeros(vertices, dtype=bool)
    used[faces.ravel()] = True
    number = np.cumsum(used) - 1
    return np.flatnonzero(used), np.asarray(number[faces], dtype=np.int64)
