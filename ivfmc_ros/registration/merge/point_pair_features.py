# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where could one surface lie on another? Answers without a first guess.

Two oriented points of one body and two of the other that lie alike fix a pose (point pair
features: Drost et al. 2010; drawn at random and judged by the surface that comes to lie on
surface: Papazov and Burschka 2010). On machined parts, where descriptors of single points are
all alike, pairs that are far apart still differ. All good poses are returned, not the best:
which of them is true is decided elsewhere.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.nearest_grid import NearGrid

# The larger body's size over the spacing of the points that are paired.
_STEPS = 36.0
# Pairs are this far apart, in sizes of the body: long ones fix a pose better.
_LEAST_LENGTH, _MOST_LENGTH = 0.2, 0.7
_ANGLE_BIN = np.radians(12.0)
_PAIRS, _PARTNERS = 6000, 40
# Points by which a pose is judged, first quickly, then the best again.
_FEW, _MANY = 60, 400
_KEPT, _DISTINCT = 4000, 150
_ALIKE = 0.8
_CHUNK = 4000
# Below this the common direction of a pair's normals is not known.
_LEVER = 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Guesses:
    """
    Poses (k, 4, 4) of one body on the other, the best first.

    share : (k,) of the body's points that come to lie on the other
    step : metres, how exact they are about
    """

    poses: Floats
    share: Floats
    step: float


def guess(body: Body, onto: Body, seed: int = 0) -> Guesses:
    """Return distinct poses onto_from_body under which much of the surface agrees."""
    rng = np.random.default_rng(seed)
    step = max(size_of(body), size_of(onto)) / _STEPS
    a, b = body.thinned(step), onto.thinned(step)
    judge = _Judge(onto=onto.thinned(step / 2), step=step)
    poses = np.concatenate([np.empty((0, 4, 4)), *_candidates(a, b, step, rng)])
    few = _spread(a, _FEW, rng)
    best = _best(poses, judge.shares(poses, few), _KEPT)
    many = _spread(a, _MANY, rng)
    share = judge.shares(best, many)
    chosen = distinct(best, share, a.patches.points_xyz, 2.0 * step)
    return Guesses(poses=best[chosen], share=share[chosen], step=step)


def size_of(body: Body) -> float:
    """Return the length of the diagonal of a body's bounding box, metres."""
    return float(np.linalg.norm(np.ptp(body.patches.points_xyz, axis=0)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Pairs:
    """Oriented pairs of points: (n,) key of how they lie, (n, 4, 4) frame on them."""

    i: Ints
    j: Ints
    key: Ints

    def frames(self, body: Body, which: Ints) -> tuple[Floats, Bools]:
        """Return (n, 4, 4) body_from_pair, and which are well enough determined."""
        p, n = body.patches.points_xyz, body.patches.normals
        i, j = self.i[which], self.j[which]
        x = p[j] - p[i]
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
        up = n[i] + n[j]
        up = up - x * (up * x).sum(axis=1, keepdims=True)
        length = np.linalg.norm(up, axis=1)
        z = up / np.maximum(length, 1e-9)[:, None]
        T = np.tile(np.eye(4), (len(i), 1, 1))
        T[:, :3, 0], T[:, :3, 1], T[:, :3, 2] = x, np.cross(z, x), z
        T[:, :3, 3] = (p[i] + p[j]) / 2
        return T, length > _LEVER


def _pairs(body: Body, i: Ints, j: Ints, lengths: tuple[float, float], step: float) -> _Pairs:
    p, n = body.patches.points_xyz, body.patches.normals
    d = p[j] - p[i]
    length = np.linalg.norm(d, axis=1)
    used = (length > lengths[0]) & (length < lengths[1])
    i, j, d, length = i[used], j[used], d[used], length[used]
    d = d / length[:, None]
    angles = [
        np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        for one, other in ((n[i], d), (n[j], d), (n[i], n[j]))
    ]
    key = np.floor(length / step).astype(np.int64)
    for angle in angles:
        key = key * 64 + np.round(angle / _ANGLE_BIN).astype(np.int64)
    return _Pairs(i=i, j=j, key=key)


def _candidates(a: Body, b: Body, step: float, rng: np.random.Generator) -> Iterator[Floats]:
    """Give poses b_from_a from pairs that lie alike."""
    lengths = (_LEAST_LENGTH * size_of(a), _MOST_LENGTH * size_of(a))
    every = np.indices((len(b), len(b))).reshape(2, -1)
    known = _pairs(b, every[0], every[1], lengths, step)
    order = np.argsort(known.key, kind='stable')
    keys = known.key[order]
    drawn = rng.integers(len(a), size=(2, 4 * _PAIRS))
    asked = _pairs(a, drawn[0], drawn[1], lengths, step)
    first = np.searchsorted(keys, asked.key[:_PAIRS])
    count = np.searchsorted(keys, asked.key[:_PAIRS], side='right') - first
    pair = np.repeat(np.arange(len(count)), np.minimum(count, _PARTNERS))
    partner = order[first[pair] + (rng.random(len(pair)) * count[pair]).astype(np.int64)]
    for begin in range(0, len(pair), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        from_a, sound_a = asked.frames(a, pair[part])
        from_b, sound_b = known.frames(b, partner[part])
        sound = sound_a & sound_b
        yield from_b[sound] @ np.linalg.inv(from_a[sound])


class _Judge:
    """Tells how much of a body comes to lie on the other."""

    def __init__(self, *, onto: Body, step: float) -> None:
        self._normals = onto.patches.normals
        self._grid = NearGrid.of(onto.patches.points_xyz, step / 2, 1.2 * step)

    def shares(self, poses: Floats, body: Body) -> Floats:
        """Return (k,) the share of the body's points that lie on the other under (k, 4, 4)."""
        p, n = body.patches.points_xyz, body.patches.normals
        found = [np.empty(0)]
        for begin in range(0, len(poses), _CHUNK):
            T = poses[begin : begin + _CHUNK]
            R = np.swapaxes(T[:, :3, :3], 1, 2)
            index = self._grid.find(p @ R + T[:, None, :3, 3])
            alike = ((n @ R) * self._normals[index]).sum(axis=-1) > _ALIKE
            found.append((alike & (index >= 0)).mean(axis=1))
        return np.concatenate(found)


def _spread(body: Body, count: int, rng: np.random.Generator) -> Body:
    return body.chosen(rng.permutation(len(body))[:count])


def _best(poses: Floats, share: Floats, count: int) -> Floats:
    return np.asarray(poses[np.argsort(-share, kind='stable')[:count]])


def distinct(poses: Floats, share: Floats, points_xyz: Floats, apart: float) -> Ints:
    """Return the best poses that put some of the points more than ``apart`` from each other."""
    corners = box_corners(points_xyz)
    placed = np.einsum('kij,cj->kci', poses[:, :3, :3], corners) + poses[:, None, :3, 3]
    left = np.argsort(-share, kind='stable')
    chosen: list[int] = []
    while len(left) and len(chosen) < _DISTINCT:
        best = int(left[0])
        chosen.append(best)
        far = np.linalg.norm(placed[left] - placed[best], axis=2).max(axis=1) > apart
        left = left[far]
    return np.array(chosen, dtype=np.int64)


def box_corners(points_xyz: Floats) -> Floats:
    """Return (8, 3) the corners of the box around (n, 3) points."""
    ends = np.stack([points_xyz.min(axis=0), points_xyz.max(axis=0)])
    return np.array(
        [[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
