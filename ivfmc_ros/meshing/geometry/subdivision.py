# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Subdivision of long edges, so that the vertices of a mesh sample its surface."""

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


def split_long_edges(columns: Floats, faces: Ints, longest: float) -> tuple[Floats, Ints]:
    """
    Halve all edges above a length until none is left; the surface stays what it was.

    A face of which one, two or three edges are halved becomes two, three or four faces, so that
    neighbors keep common edges.

    columns : (n, c) x, y, z (meters) and further values of the vertices; NaN is a value that is
        not known, and so is its mean with another one
    faces : (m, 3); longest : meters, positive
    returns : columns of the vertices, the given ones first, and faces in the given orientation
    """
    faces = faces.astype(np.int64, copy=False)  # an edge is numbered by a product
    while True:
        following = np.roll(faces, -1, axis=1)
        span = columns[faces, :3] - columns[following, :3]
        halved = np.linalg.norm(span, axis=2) > longest
        if not halved.any():
            return columns, faces
        ends = np.sort(np.stack([faces[halved], following[halved]], axis=1), axis=1)
        key, edge = np.unique(ends[:, 0] * len(columns) + ends[:, 1], return_inverse=True)
        middle = np.full(faces.shape, -1)
        middle[halved] = len(columns) + edge.reshape(-1)
        first, second = np.divmod(key, len(columns))
        columns = np.concatenate([columns, 0.5 * (columns[first] + columns[second])])
        faces = _with_middles(faces, middle)


def _with_middles(faces: Ints, middle: Ints) -> Ints:
    """Divide faces (m, 3); ``middle`` (m, 3): vertex in the edge to the next corner, or -1."""
    cut: Bools = middle >= 0
    count = cut.sum(axis=1)
    # the one edge that differs from both others comes first
    first = np.where(count == 1, cut.argmax(axis=1), (~cut).argmax(axis=1))
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, turn, axis=1).T
    one, two, three = (count == number for number in (1, 2, 3))
    return np.concatenate(
        [
            faces[count == 0],
            _triangles(one, (a, ab, c), (ab, b, c)),
            _triangles(two, (bc, c, ca), (a, b, bc), (a, bc, ca)),
            _triangles(three, (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)),
        ]
    )


def _triangles(chosen: Bools, *corners: tuple[Ints, Ints, Ints]) -> Ints:
    return np.concatenate([np.stack(own, axis=1)[chosen] for own in corners])
