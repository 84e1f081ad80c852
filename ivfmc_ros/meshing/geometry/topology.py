# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How triangles hang together: pieces, boundary loops, fans."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import coo_array
from scipy.sparse import csc_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_ROUNDS = 20


@dataclass(frozen=True, kw_only=True)
class Loop:
    """
    A closed run of boundary edges: where a mesh is open.

    length : metres; center_xyz : metres, mean of its vertices
    """

    edges: int
    length: float
    center_xyz: tuple[float, float, float]


def adding(faces: Ints, vertices: int, dtype: DTypeLike = np.float64) -> csc_array:
    """Return the (vertices, faces) matrix that adds up what is given for the faces of each."""
    corners = faces.shape[1]
    return csc_array(
        (
            np.ones(faces.size, dtype=dtype),
            faces.ravel(),
            np.arange(0, faces.size + 1, corners),
        ),
        shape=(vertices, len(faces)),
    )


def pieces(faces: Ints, vertices: int) -> Ints:
    """Return (m,) of each face the number of its piece: faces that share a vertex are one."""
    first = np.repeat(faces[:, 0], faces.shape[1] - 1)
    graph = coo_array(
        (np.ones(len(first), dtype=np.int8), (first, faces[:, 1:].ravel())),
        shape=(vertices, vertices),
    )
    _, label = connected_components(graph, directed=False)
    return np.asarray(label[faces[:, 0]], dtype=np.int64)


def large_pieces(faces: Ints, vertices: int, least: int) -> Bools:
    """Tell of each face whether its piece has at least ``least`` faces."""
    if not len(faces):
        return np.zeros(0, dtype=bool)
    piece = pieces(faces, vertices)
    return np.asarray(np.bincount(piece)[piece] >= least)


def boundary_edges(faces: Ints) -> Ints:
    """Return the (n, 2) directed edges that belong to one face only."""
    following = np.roll(faces, -1, axis=1)
    edges = np.stack([faces.ravel(), following.ravel()], axis=1)
    low, high = edges.min(axis=1), edges.max(axis=1)
    key = low * (int(faces.max(initial=0)) + 1) + high
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    return np.asarray(edges[first[count == 1]])


def boundary_loops(vertices_xyz: Floats, faces: Ints) -> list[Loop]:
    """Return the loops of a mesh's boundary, the longest first."""
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
        Loop(
            edges=int(number[k]),
            length=float(total[k]),
            center_xyz=(float(center[k, 0]), float(center[k, 1]), float(center[k, 2])),
        )
        for k in np.argsort(-total)
    ]


def without_bow_ties(faces: Ints, vertices: int) -> Bools:
    """
    Tell which faces to keep so that no vertex is met by two fans of faces.

    Of the fans at such a vertex the largest stays. Faces are of a 2-manifold of which some have
    been taken away.
    """
    keep = np.ones(len(faces), dtype=bool)
    for _ in range(_ROUNDS):
        chosen = np.flatnonzero(keep)
        bad = _small_fans(faces[chosen], vertices)
        if not bad.any():
            break
        keep[chosen[bad]] = False
    return keep


def _small_fans(faces: Ints, vertices: int) -> Bools:
    """Tell which faces are in a smaller fan of a vertex that has two."""
    edges = boundary_edges(faces)
    ends = np.bincount(edges.ravel(), minlength=vertices)
    pinched = ends > 2
    bad = np.zeros(len(faces), dtype=bool)
    around = np.flatnonzero(pinched[faces].any(axis=1))
    for vertex in np.unique(faces[around][pinched[faces[around]]]).tolist():
        fan = around[(faces[around] == vertex).any(axis=1)]
        label = _fans(faces[fan], vertex)
        bad[fan[label != np.bincount(label).argmax()]] = True
    return bad


def _fans(faces: Ints, vertex: int) -> Ints:
    """Number the fans of the faces around a vertex: those of a fan share an edge at it."""
    at = np.argmax(faces == vertex, axis=1)
    rows = np.arange(len(faces))
    sides = faces.shape[1]
    after, before = faces[rows, (at + 1) % sides], faces[rows, (at - 1) % sides]
    linked = (after[:, None] == before[None]) | (before[:, None] == after[None])
    _, label = connected_components(coo_array(linked), directed=False)
    return np.asarray(label, dtype=np.int64)


def compact(faces: Ints, vertices: int) -> tuple[Ints, Ints]:
    """Return which vertices faces use, and the faces over those."""
    used = np.zeros(vertices, dtype=bool)
    used[faces.ravel()] = True
    number = np.cumsum(used) - 1
    return np.flatnonzero(used), np.asarray(number[faces], dtype=np.int64)
