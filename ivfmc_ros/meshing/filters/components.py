# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Selection of the connected components of a surface that belong to the part."""

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.model import Bools
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds

# Least share of measured quads in any component but the largest. A closed component with fewer
# grew by hole filling around a few outliers.
_MIN_MEASURED_SHARE = 0.3
# A component is isolated if it has less than this share of all quads, and is farther than this
# (voxels) from all larger ones. Measured on the real scan of bench_mesh.py: its outliers have
# 0.9 % and are 46 voxels away; components of the part are within 3 voxels of another.
_MAX_ISOLATED_SHARE, _ISOLATION_DISTANCE = 0.02, 20.0


def select_components(component: Ints, kind: Kinds, min_quads: int) -> Bools:
    """
    Return which quads are in a component that is large enough and was measured in part.

    component : (m,) label of the connected component of each quad
    kind : (m,) uint8, MEASURED, BRIDGED, BASE or FILLED
    returns : (m,) bool
    """
    if not len(component):
        return np.zeros(0, dtype=bool)
    size = np.bincount(component)
    measured = np.bincount(component, kind <= BRIDGED) / np.maximum(size, 1)
    required = np.where(size == size.max(), 0.0, _MIN_MEASURED_SHARE)
    return np.asarray(((size >= min_quads) & (measured >= required))[component])


def find_isolated_components(
    vertices_xyz: Floats, quads: Ints, component: Ints, voxel: float
) -> tuple[Bools, int]:
    """
    Find components that are small and far from every larger component that is not isolated.

    vertices_xyz : (n, 3) float64, meters
    quads : (m, 4) int64
    component : (m,) label of the connected component of each quad
    voxel : meters
    returns : (m,) bool, the quads of isolated components; and the number of these components
    """
    size = np.bincount(component)
    order = np.argsort(-size, kind='stable')
    small = size[order] < _MAX_ISOLATED_SHARE * len(component)
    small[:1] = False
    order, large = order[small & (size[order] > 0)], order[~small]
    if not len(order):
        return np.zeros(len(quads), dtype=bool), 0
    vertex_component = np.full(len(vertices_xyz), -1)
    vertex_component[quads] = component[:, None]
    isolated = np.zeros(len(size), dtype=bool)
    distance = _ISOLATION_DISTANCE * voxel
    isolated[_isolated(vertices_xyz, vertex_component, order, large, distance)] = True
    return isolated[component], int(isolated.sum())


def _isolated(
    vertices_xyz: Floats, vertex_component: Ints, order: Ints, large: Ints, distance: float
) -> Ints:
    """
    Return which components of ``order`` are near no large one, nor an earlier one that is near.

    vertex_component : (n,) label of the component of each vertex, -1 for none
    order : labels of the small components, the largest first
    large : labels of the large components
    distance : meters; vertices nearer than this are near
    """
    is_large = np.zeros(int(vertex_component.max()) + 1, dtype=bool)
    is_large[large] = True
    rest = vertices_xyz[(vertex_component >= 0) & is_large[vertex_component]]
    points = _vertices_of(vertices_xyz, vertex_component, order)
    gap, _ = cKDTree(rest, balanced_tree=False).query(
        np.concatenate(points), distance_upper_bound=distance
    )
    bounds = np.cumsum([0, *map(len, points)])
    near = np.maximum.reduceat(np.isfinite(gap), bounds[:-1])
    low = np.array([each.min(axis=0) for each in points])
    high = np.array([each.max(axis=0) for each in points])
    for k in np.flatnonzero(~near).tolist():
        candidates = near[:k] & (
            (low[:k] <= high[k] + distance) & (high[:k] >= low[k] - distance)
        ).all(axis=1)
        tree = cKDTree(points[k])
        near[k] = any(
            np.isfinite(tree.query(points[j], distance_upper_bound=distance)[0]).any()
            for j in np.flatnonzero(candidates).tolist()
        )
    return np.asarray(order[~near])


def _vertices_of(vertices_xyz: Floats, vertex_component: Ints, order: Ints) -> list[Floats]:
    """Return the vertices of each component of ``order``, by one sort of all vertices."""
    by_component = np.argsort(vertex_component, kind='stable')
    ordered = vertex_component[by_component]
    first, last = (np.searchsorted(ordered, order, side=side) for side in ('left', 'right'))
    return [vertices_xyz[by_component[a:b]] for a, b in zip(first, last, strict=True)]
