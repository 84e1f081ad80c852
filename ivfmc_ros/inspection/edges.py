# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Edges of a nominal mesh, between its regions, and the distance of points from them."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Meters between the points by which an edge is represented; the distance of a point from it is too
# large by at most 2 micrometers at 1 mm.
_SPACING = 0.1e-3
# Points of all edges at most: a nominal of many short edges.
_MAX_POINTS = 2_000_000


def region_of_faces(regions: Sequence[SurfaceRegion], faces: int) -> Ints:
    """Return the index of the region of each face, or -1, (faces,)."""
    owner = np.full(faces, -1)
    for number, region in enumerate(regions):
        owner[region.faces] = number
    return owner


def edge_distance(vertices_xyz: Floats, faces: Ints, region: Ints, points_xyz: Floats) -> Floats:
    """
    Return the distances of points (n, 3) from the edges between regions, (n,) meters.

    vertices_xyz, faces : of the nominal
    region : (m,) index of the region of each face; an edge of a face without one (-1) counts too
    """
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    ordered = np.sort(edges, axis=1)
    owner = np.repeat(region, 3)
    order = np.lexsort((ordered[:, 1], ordered[:, 0]))
    same = (ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    between = (owner[first] != owner[second]) | (owner[first] < 0)
    sampled = _sampled(vertices_xyz[ordered[first[between]]])
    if not len(sampled):
        return np.full(len(points_xyz), np.inf)
    return np.asarray(cKDTree(sampled).query(points_xyz, workers=-1)[0])


def _sampled(ends: Floats) -> Floats:
    """Return points on line segments (k, 2, 3), at most ``_SPACING`` apart."""
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    spacing = max(_SPACING, float(length.sum()) / _MAX_POINTS)
    count = np.ceil(length / spacing).astype(np.int64) + 1
    segment = np.repeat(np.arange(len(ends)), count)
    place = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    share = (place / np.maximum(count[segment] - 1, 1))[:, None]
    return np.asarray((1.0 - share) * ends[segment, 0] + share * ends[segment, 1])
