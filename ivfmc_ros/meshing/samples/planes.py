# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robust local planes: RANSAC over the neighbors of each query point (Fischler & Bolles 1981)."""

from dataclasses import dataclass
from dataclasses import fields
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_HYPOTHESES = 80  # per query point
_NEAREST = 10  # every other hypothesis is drawn from so many nearest neighbors only
# The three points of a hypothesis span at least a square of this side, voxels.
_MIN_SPAN = 0.5
# Least cosine between the normal of an inlier, if it has one, and the plane; 16 degrees.
_MIN_NORMAL_COSINE = 0.96
_MIN_ORIENTED_INLIERS = 6  # with a normal, if the neighborhood has normals
_FAR_WEIGHT = 1e-4  # weight of a neighbor at any distance
_CHUNK = 1 << 11  # query points; their neighbors stay in the processor's cache
_SAME_POINT = 1e-9  # meters; a neighbor this near is the query point itself
_DUPLICATE_CELL = 0.05  # voxels; points in one such cell count as one


@dataclass(frozen=True, eq=False, kw_only=True)
class Neighborhood:
    """
    Points from which planes are estimated, and how they are searched and weighted.

    points_xyz : (n, 3) meters
    normals : (n, 3) unit, of either sign, NaN where unknown; or None
    max_neighbors : number of nearest neighbors
    radius : meters, search radius
    distance_sigma : meters, 1 sigma of the Gaussian weight of a neighbor by its distance
    """

    points_xyz: Floats
    max_neighbors: int
    radius: float
    distance_sigma: float
    normals: Floats | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalPlanes:
    """
    A plane for each of n query points.

    normals : (n, 3) unit, of either sign
    height : (n,) meters, of the point over the plane along the normal
    inlier_ratio : (n,) weighted share of the neighbors that lie in the plane
    inliers : (n,) number of these
    breadth : (n,) meters, 1 sigma of the inliers along their second principal axis
    height_sigma : (n,) 1 sigma of the plane at the point, in units of 1 sigma of an inlier
    centroid : (n, 3) meters, of the inliers, from the query point
    scatter : (n, 3, 3) square meters, covariance of the inliers
    """

    normals: Floats
    height: Floats
    inlier_ratio: Floats
    inliers: Floats
    breadth: Floats
    height_sigma: Floats
    centroid: Floats
    scatter: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class _Neighbors:
    """
    The k nearest neighbors of n query points.

    offsets : (n, k, 3) meters, from the query point
    weight : (n, k), 0 where there is no neighbor
    valid : (n, k)
    normals : (n, k, 3), or None
    """

    offsets: Floats
    weight: Floats
    valid: Bools
    normals: Floats | None

    def inliers(self, normals: Floats, height: Floats, tolerance: float) -> Bools:
        """Return (n, k) bool, the neighbors in one plane for each query point."""
        distance = np.einsum('nkc,nc->nk', self.offsets, normals) + height[:, None]
        inside = self.valid & (np.abs(distance) < tolerance)
        if self.normals is None:
            return np.asarray(inside)
        with np.errstate(invalid='ignore'):
            cosine = np.abs(np.einsum('nkc,nc->nk', self.normals, normals))
        return np.asarray(inside & ~(cosine <= _MIN_NORMAL_COSINE))


def fit_planes(
    queries: Floats,
    neighborhood: Neighborhood,
    tolerance: float,
    voxel: float,
    *,
    through_query: bool,
) -> LocalPlanes:
    """
    Fit the plane that contains most of the neighbors of each query point.

    queries : (n, 3) meters; points of ``neighborhood`` at the same place are ignored
    tolerance : meters, greatest distance of an inlier
    voxel : meters, unit of the limits above
    through_query : planes contain the query point; otherwise the query point is not used
    """
    neighborhood = _without_duplicates(neighborhood, _DUPLICATE_CELL * voxel)
    tree = cKDTree(neighborhood.points_xyz, balanced_tree=False)
    queries, place = np.unique(queries, axis=0, return_inverse=True)
    place = place.ravel()

    def fit(chunk: slice) -> LocalPlanes:
        neighbors = _find_neighbors(tree, queries[chunk], neighborhood)
        return _fit_chunk(neighbors, tolerance, voxel, through_query=through_query)

    parts = list(map_chunked(fit, max(len(queries), 1), _CHUNK))
    return LocalPlanes(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])[place]
            for field in fields(LocalPlanes)
        }
    )


def _without_duplicates(neighborhood: Neighborhood, size: float) -> Neighborhood:
    """Keep one point in each cell: a k-d tree of a million points at one place takes hours."""
    cell = np.floor(neighborhood.points_xyz / size).astype(np.int64)
    key = cell @ np.array([1, 1 << 21, 1 << 42])
    kept = np.sort(np.unique(key, return_index=True)[1])
    normals = None if neighborhood.normals is None else neighborhood.normals[kept]
    return replace(neighborhood, points_xyz=neighborhood.points_xyz[kept], normals=normals)


def _find_neighbors(tree: cKDTree, queries: Floats, neighborhood: Neighborhood) -> _Neighbors:
    distance, index = tree.query(
        queries,
        k=neighborhood.max_neighbors,
        distance_upper_bound=neighborhood.radius,
    )
    valid = np.isfinite(distance) & (distance > _SAME_POINT)
    index = np.where(valid, index, 0)
    scaled = np.where(valid, distance, 0.0) / neighborhood.distance_sigma
    weight = np.exp(-0.5 * scaled**2) + _FAR_WEIGHT
    return _Neighbors(
        offsets=neighborhood.points_xyz[index] - queries[:, None],
        weight=weight * valid,
        valid=valid,
        normals=None if neighborhood.normals is None else neighborhood.normals[index],
    )


def _fit_chunk(
    neighbors: _Neighbors, tolerance: float, voxel: float, *, through_query: bool
) -> LocalPlanes:
    """Refine the best hypothesis of each query point by a principal component analysis."""
    normals, height, best = _ransac(neighbors, tolerance, voxel, through_query=through_query)
    inlier = neighbors.inliers(normals, height, tolerance)
    count = inlier.sum(axis=1) + float(through_query)
    safe = np.maximum(count, 1.0)[:, None]
    centroid = (neighbors.offsets * inlier[..., None]).sum(axis=1) / safe
    centered = (neighbors.offsets - centroid[:, None]) * inlier[..., None]
    scatter = np.einsum('nki,nkj->nij', centered, centered)
    if through_query:
        scatter += centroid[:, :, None] * centroid[:, None, :]
    scatter /= safe[..., None]
    variances, axes = np.linalg.eigh(scatter)
    along = np.einsum('nc,nca->na', centroid, axes[:, :, 1:])
    leverage = (along**2 / np.maximum(variances[:, 1:], 1e-18)).sum(axis=1)
    normals = axes[:, :, 0]
    return LocalPlanes(
        normals=normals,
        height=-(centroid * normals).sum(axis=1),
        inlier_ratio=best / np.maximum(neighbors.weight.sum(axis=1), 1e-30),
        inliers=count,
        breadth=np.sqrt(np.maximum(variances[:, 1], 0.0)),
        height_sigma=np.sqrt((1.0 + leverage) / safe[:, 0]),
        centroid=centroid,
        scatter=scatter,
    )


def _ransac(
    neighbors: _Neighbors, tolerance: float, voxel: float, *, through_query: bool
) -> tuple[Floats, Floats, Floats]:
    """Return (n, 3) normals, (n,) heights and (n,) inlier weights of the best hypotheses."""
    rng = np.random.default_rng(0)
    size, count = neighbors.valid.shape
    best, height = np.zeros(size), np.zeros(size)
    normals = np.zeros((size, 3))
    if not (neighbors.valid.sum(axis=1) >= 3 - through_query).any():
        return normals, height, best
    for hypothesis in range(_HYPOTHESES):
        among = count if hypothesis % 2 else min(_NEAREST, count)
        if among < 3:
            break
        i, j, k = rng.choice(among, 3, replace=False)
        origin = np.zeros((size, 3)) if through_query else neighbors.offsets[:, k]
        normal = np.cross(neighbors.offsets[:, i] - origin, neighbors.offsets[:, j] - origin)
        area = np.linalg.norm(normal, axis=1)
        normal /= np.maximum(area, 1e-30)[:, None]
        over = -(normal * origin).sum(axis=1)
        inlier = neighbors.inliers(normal, over, tolerance)
        score = (neighbors.weight * inlier).sum(axis=1)
        sound = (area > (_MIN_SPAN * voxel) ** 2) & neighbors.valid[:, [i, j]].all(axis=1)
        if not through_query:
            sound &= neighbors.valid[:, k]
        if neighbors.normals is not None:
            oriented = np.isfinite(neighbors.normals[..., 0])
            sound &= (inlier & oriented).sum(axis=1) >= _MIN_ORIENTED_INLIERS
        better = sound & (score > best)
        best[better], height[better] = score[better], over[better]
        normals[better] = normal[better]
    return normals, height, best
