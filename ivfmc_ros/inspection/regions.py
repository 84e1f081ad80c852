# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Segmentation of a nominal mesh into smooth regions, the faces of CAD, and their shapes."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.meshing.geometry import normals as triangle_normals
from ivfmc_ros.meshing.geometry.areas import face_areas
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Radians; neighboring triangles with a smaller angle between normals belong to one region.
_MAX_SMOOTH_ANGLE = np.radians(20.0)
# Largest form error of a recognized shape, fraction of the size of the region.
_MAX_FORM_ERROR = 2e-4
# Smallest standard deviation of a sphere's normals in any direction; those of a cone have none
# along its axis.
_MIN_NORMAL_DEVIATION = 0.01
# Regions that are listed at most.
_MAX_REGIONS = 200
# Fraction of the whole surface; smaller regions are not listed.
_MIN_AREA = 5e-4
# Areas that agree to so many digits, as fractions of the largest, are equal.
_AREA_DIGITS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceRegion:
    """
    A smooth region of a nominal mesh.

    name : such as 'cylinder 3'
    faces : (k,) indices of the nominal's triangles
    area : square meters
    shape : the shape through its vertices, or None for a free-form region
    facet_depth : meters, mean distance of the faces from the shape: a round shape through the
        vertices of flat faces is larger than these
    """

    name: str
    faces: Ints
    area: float
    shape: features.Feature | None
    facet_depth: float = 0.0


def segment_surface(vertices_xyz: Floats, faces: Ints) -> list[SurfaceRegion]:
    """
    Split a mesh into smooth regions, the largest first, without tiny ones.

    Regions of one area are in the order of their triangles, so that rounding, as of a mesh that
    was moved, does not change the names.
    """
    label = _smooth_components(vertices_xyz, faces)
    corners = vertices_xyz[faces]
    area = face_areas(vertices_xyz, faces)
    total = np.bincount(label, area).astype(np.float64)
    found: list[SurfaceRegion] = []
    for component in _largest_first(total)[:_MAX_REGIONS]:
        if total[component] < _MIN_AREA * total.sum():
            break
        chosen = np.flatnonzero(label == component)
        shape = _shape(vertices_xyz, faces[chosen])
        kind = 'free form' if shape is None else shape.kind
        number = 1 + sum(region.name.startswith(kind) for region in found)
        found.append(
            SurfaceRegion(
                name=f'{kind} {number}',
                faces=chosen,
                area=float(total[component]),
                shape=shape,
                facet_depth=_facet_depth(shape, corners[chosen], area[chosen]),
            )
        )
    return found


def _largest_first(areas: Floats) -> Ints:
    """Return the order of (n,) areas, descending; equal ones as they are."""
    return np.asarray(
        np.argsort(-np.round(areas / max(areas.max(), 1e-30), _AREA_DIGITS), kind='stable')
    )


def _facet_depth(shape: features.Feature | None, corners: Floats, area: Floats) -> float:
    """Return the mean distance of triangles (k, 3, 3) from the shape through their corners."""
    if shape is None or shape.kind == 'plane':
        return 0.0
    # midpoints of the edges integrate a quadratic function over a triangle exactly
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    depth = np.abs(features.residuals(shape, middles.reshape(-1, 3))).reshape(-1, 3).mean(axis=1)
    return float(np.average(depth, weights=np.maximum(area, 1e-30)))


def _smooth_components(vertices: Floats, faces: Ints) -> Ints:
    normal = np.nan_to_num(triangle_normals.face_normals(vertices, faces))
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    first, second = order[:-1][same] // 3, order[1:][same] // 3
    smooth = (normal[first] * normal[second]).sum(axis=1) > np.cos(_MAX_SMOOTH_ANGLE)
    graph = coo_array(
        (np.ones(int(smooth.sum())), (first[smooth], second[smooth])), shape=(len(faces),) * 2
    )
    _, label = connected_components(graph, directed=False)
    return np.asarray(label, dtype=np.int64)


def _shape(vertices: Floats, faces: Ints) -> features.Feature | None:
    """Return the simplest shape that fits the vertices and normals of a region, or None."""
    points = vertices[np.unique(faces)]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    chosen = points[:: max(1, len(points) // 2000)]
    for kind in ('plane', 'cylinder', 'sphere'):
        try:
            found = features.fit(kind, chosen)
        except GeometryError:
            continue
        if found.form < _MAX_FORM_ERROR * size and _normals_match(found, vertices, faces):
            return found
    return None


def _normals_match(shape: features.Feature, vertices: Floats, faces: Ints) -> bool:
    """Check that the normals of the faces are those of the shape; they are not on a cone."""
    if shape.kind == 'plane':
        return True
    normal = np.nan_to_num(triangle_normals.face_normals(vertices, faces))
    if shape.kind == 'sphere' and np.std(normal @ _least_axis(normal)) < _MIN_NORMAL_DEVIATION:
        # two circles of vertices always lie on a sphere: this is a chamfer or a cone
        return False
    radius = vertices[faces].mean(axis=1) - shape.center_xyz
    if shape.kind == 'cylinder':
        radius = radius - (radius @ shape.axis)[:, None] * shape.axis
    radius /= np.linalg.norm(radius, axis=1, keepdims=True)
    return bool(np.median(np.abs((radius * normal).sum(axis=1))) > np.cos(_MAX_SMOOTH_ANGLE))


def _least_axis(vectors: Floats) -> Floats:
    """Return the unit direction of the smallest variance of (n, 3) vectors."""
    return np.asarray(np.linalg.eigh(np.cov(vectors.T))[1][:, 0])
