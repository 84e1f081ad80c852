# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plane that most of the points around a point lie in, however many lie beside it."""

from dataclasses import dataclass
from dataclasses import fields
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_GUESSES = 80
_NEAREST = 10  # every other guess is of these
# Three points of a guess span at least a square of this (voxels).
_LEAST_SPAN = 0.5
# Points with a normal belong to a plane of about the same one (cosine).
_AGREEING = 0.96
_LEAST_AGREEING = 6
_FAR = 1e-4  # weight of a neighbour at any distance
_AT_ONCE = 1 << 14  # points
_ITSELF = 1e-9  # metres
_SAME = 0.05  # voxels, within which points count as one


@dataclass(frozen=True, eq=False, kw_only=True)
class Around:
    """
    Which points tell of a plane.

    points_xyz : (n, 3) metres
    normals : (n, 3) unit of either sign, NaN where not known; or None
    count : how many of the nearest; reach : metres, within which these are
    scale : metres, 1 sigma of the weight of a neighbour by its distance
    """

    points_xyz: Floats
    count: int
    reach: float
    scale: float
    normals: Floats | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Planes:
    """
    A plane for each of n points.

    normals : (n, 3) unit, of either sign
    height : (n,) metres of the point over the plane, along the normal
    share : (n,) of the points around, by weight, that lie in it
    members : (n,) how many these are
    breadth : (n,) metres, 1 sigma of them across the direction in which they are spread most
    spread : (n,) 1 sigma of the plane at the point, in sigmas of a member
    """

    normals: Floats
    height: Floats
    share: Floats
    members: Floats
    breadth: Floats
    spread: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class _Near:
    """What is around each point: offsets (n, k, 3), weights and normals likewise."""

    offsets: Floats
    weight: Floats
    there: Bools
    normals: Floats | None

    def members(self, normals: Floats, height: Floats, tolerance: float) -> Bools:
        off = np.einsum('nkc,nc->nk', self.offsets, normals) + height[:, None]
        inside = self.there & (np.abs(off) < tolerance)
        if self.normals is None:
            return np.asarray(inside)
        with np.errstate(invalid='ignore'):
            cosine = np.abs(np.einsum('nkc,nc->nk', self.normals, normals))
        return np.asarray(inside & ~(cosine <= _AGREEING))


def planes_at(
    asked: Floats, around: Around, tolerance: float, voxel: float, *, through: bool
) -> Planes:
    """
    Return the plane of most of the points around each point (random sample consensus).

    asked : (n, 3) metres; one of ``around`` at the same place does not count
    tolerance : metres within which a point is in a plane
    through : the plane goes through the point itself; else the point has no say
    """
    around = _without_copies(around, _SAME * voxel)
    tree = cKDTree(around.points_xyz)
    parts = []
    asked, place = np.unique(asked, axis=0, return_inverse=True)
    place = place.ravel()
    for start in range(0, max(len(asked), 1), _AT_ONCE):
        near = _near(tree, asked[start : start + _AT_ONCE], around)
        parts.append(_fitted(near, tolerance, voxel, through=through))
    return Planes(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])[place]
            for field in fields(Planes)
        }
    )


def _without_copies(around: Around, step: float) -> Around:
    """Leave one point in each cell: in a tree, a million at one place take hours."""
    cell = np.floor(around.points_xyz / step).astype(np.int64)
    key = cell @ np.array([1, 1 << 21, 1 << 42])
    kept = np.sort(np.unique(key, return_index=True)[1])
    normals = None if around.normals is None else around.normals[kept]
    return replace(around, points_xyz=around.points_xyz[kept], normals=normals)


def _near(tree: cKDTree, asked: Floats, around: Around) -> _Near:
    distance, index = tree.query(
        asked, k=around.count, distance_upper_bound=around.reach, workers=-1
    )
    there = np.isfinite(distance) & (distance > _ITSELF)
    index = np.where(there, index, 0)
    weight = np.exp(-0.5 * (np.where(there, distance, 0.0) / around.scale) ** 2) + _FAR
    return _Near(
        offsets=around.points_xyz[index] - asked[:, None],
        weight=weight * there,
        there=there,
        normals=None if around.normals is None else around.normals[index],
    )


def _fitted(near: _Near, tolerance: float, voxel: float, *, through: bool) -> Planes:
    normals, height, best = _guessed(near, tolerance, voxel, through=through)
    member = near.members(normals, height, tolerance)
    count = member.sum(axis=1) + float(through)
    safe = np.maximum(count, 1.0)[:, None]
    middle = (near.offsets * member[..., None]).sum(axis=1) / safe
    spread = (near.offsets - middle[:, None]) * member[..., None]
    scatter = np.einsum('nki,nkj->nij', spread, spread)
    if through:
        scatter += middle[:, :, None] * middle[:, None, :]
    extents, axes = np.linalg.eigh(scatter / safe[..., None])
    along = np.einsum('nc,nca->na', middle, axes[:, :, 1:])
    leverage = (along**2 / np.maximum(extents[:, 1:], 1e-18)).sum(axis=1)
    normals = axes[:, :, 0]
    return Planes(
        normals=normals,
        height=-(middle * normals).sum(axis=1),
        share=best / np.maximum(near.weight.sum(axis=1), 1e-30),
        members=count,
        breadth=np.sqrt(np.maximum(extents[:, 1], 0.0)),
        spread=np.sqrt((1.0 + leverage) / safe[:, 0]),
    )


def _guessed(
    near: _Near, tolerance: float, voxel: float, *, through: bool
) -> tuple[Floats, Floats, Floats]:
    """Return normals, heights and the weight of the members of the best guesses."""
    rng = np.random.default_rng(0)
    size, neighbours = near.there.shape
    best, height = np.zeros(size), np.zeros(size)
    normals = np.zeros((size, 3))
    if not (near.there.sum(axis=1) >= 3 - through).any():
        return normals, height, best
    for guess in range(_GUESSES):
        among = neighbours if guess % 2 else min(_NEAREST, neighbours)
        if among < 3:
            break
        i, j, k = rng.choice(among, 3, replace=False)
        origin = np.zeros((size, 3)) if through else near.offsets[:, k]
        across = np.cross(near.offsets[:, i] - origin, near.offsets[:, j] - origin)
        area = np.linalg.norm(across, axis=1)
        across /= np.maximum(area, 1e-30)[:, None]
        over = -(across * origin).sum(axis=1)
        member = near.members(across, over, tolerance)
        score = (near.weight * member).sum(axis=1)
        sound = (area > (_LEAST_SPAN * voxel) ** 2) & near.there[:, [i, j]].all(axis=1)
        if not through:
            sound &= near.there[:, k]
        if near.normals is not None:
            oriented = np.isfinite(near.normals[..., 0])
            sound &= (member & oriented).sum(axis=1) >= _LEAST_AGREEING
        better = sound & (score > best)
        best[better], height[better] = score[better], over[better]
        normals[better] = across[better]
    return normals, height, best
