# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Global pose search by point pair features: candidate poses of one surface on another.

Two oriented points of one surface and two of the other with the same distance and angles fix a
pose (point pair features: Drost et al. 2010). Point pairs are drawn at random, and each pose is
scored by the fraction of surfels that come to lie on the target (Papazov and Burschka 2010).
Machined parts have many points with the same local descriptor; pairs that are far apart still
differ.
All good poses are returned, because symmetric parts have several; ``pose_search`` decides.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.nearest_grid import NearestGrid

# The larger surface's size divided by the spacing of the points that form pairs.
_POINTS_PER_SIZE = 36.0
# Length of the pairs, relative to the source's size: long pairs determine a pose better, the
# longest ones are rarely visible in both scans.
_MIN_LENGTH, _MAX_LENGTH = 0.2, 0.7
# Quantization of the angles of a feature, radians (Drost et al. use 12 degrees, too).
_ANGLE_BIN = np.radians(12.0)
# Source pairs that are matched, and target pairs that each is matched with at most.
_PAIRS, _MATCHES = 6000, 40
# Points by which a pose is scored: first of all poses, then of those that are kept.
_FEW_POINTS, _MANY_POINTS = 60, 400
# Poses kept after the first scoring, and distinct poses returned.
_KEPT, _DISTINCT = 4000, 150
# Least cosine between the normals of a point and the target's surface.
_MIN_COSINE = 0.8
# Poses computed at once; limits the memory.
_CHUNK = 4000
# Least length of the sum of a pair's normals, projected across the pair: below it the rotation
# about the pair is not determined.
_MIN_NORMAL = 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidatePoses:
    """
    Candidate poses of a source on a target, the best first.

    poses : (k, 4, 4) target_from_source
    overlap : (k,) fraction of the source's points that lie on the target
    step : meters, approximate accuracy of the poses
    """

    poses: Floats
    overlap: Floats
    step: float


def search_poses(source: ClampedSurface, target: ClampedSurface, seed: int = 0) -> CandidatePoses:
    """Return distinct poses target_from_source with large overlap."""
    rng = np.random.default_rng(seed)
    step = max(diameter(source), diameter(target)) / _POINTS_PER_SIZE
    a, b = source.downsampled(step), target.downsampled(step)
    scorer = _OverlapScorer(target=target.downsampled(step / 2), step=step)
    poses = np.concatenate([np.empty((0, 4, 4)), *_candidates(a, b, step, rng)])
    few = _random_sample(a, _FEW_POINTS, rng)
    best = _best(poses, scorer.overlap(poses, few), _KEPT)
    many = _random_sample(a, _MANY_POINTS, rng)
    overlap = scorer.overlap(best, many)
    index = distinct_poses(best, overlap, a.surfels.points_xyz, 2.0 * step)
    return CandidatePoses(poses=best[index], overlap=overlap[index], step=step)


def diameter(surface: ClampedSurface) -> float:
    """Return the length of the diagonal of a surface's bounding box, meters."""
    return float(np.linalg.norm(np.ptp(surface.surfels.points_xyz, axis=0)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _PointPairs:
    """
    Correspondences of oriented points.

    i, j : (n,) indices of the surfels; feature : (n,) quantized distance and angles as one key
    """

    i: Ints
    j: Ints
    feature: Ints

    def frames(self, surface: ClampedSurface, which: Ints) -> tuple[Floats, Bools]:
        """Return (n, 4, 4) surface_from_pair of some pairs, and which of them are determined."""
        p, n = surface.surfels.points_xyz, surface.surfels.normals
        i, j = self.i[which], self.j[which]
        x = p[j] - p[i]
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
        normal = n[i] + n[j]
        normal = normal - x * (normal * x).sum(axis=1, keepdims=True)
        length = np.linalg.norm(normal, axis=1)
        z = normal / np.maximum(length, 1e-9)[:, None]
        T = np.tile(np.eye(4), (len(i), 1, 1))
        T[:, :3, 0], T[:, :3, 1], T[:, :3, 2] = x, np.cross(z, x), z
        T[:, :3, 3] = (p[i] + p[j]) / 2
        return T, length > _MIN_NORMAL


def _point_pairs(
    surface: ClampedSurface, i: Ints, j: Ints, lengths: tuple[float, float], step: float
) -> _PointPairs:
    p, n = surface.surfels.points_xyz, surface.surfels.normals
    d = p[j] - p[i]
    length = np.linalg.norm(d, axis=1)
    used = (length > lengths[0]) & (length < lengths[1])
    i, j, d, length = i[used], j[used], d[used], length[used]
    d = d / length[:, None]
    angles = [
        np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        for one, other in ((n[i], d), (n[j], d), (n[i], n[j]))
    ]
    feature = np.floor(length / step).astype(np.int64)
    for angle in angles:
        feature = feature * 64 + np.round(angle / _ANGLE_BIN).astype(np.int64)
    return _PointPairs(i=i, j=j, feature=feature)


def _candidates(
    a: ClampedSurface, b: ClampedSurface, step: float, rng: np.random.Generator
) -> Iterator[Floats]:
    """Yield poses b_from_a, (k, 4, 4), from pairs with equal features."""
    lengths = (_MIN_LENGTH * diameter(a), _MAX_LENGTH * diameter(a))
    every = np.indices((len(b), len(b))).reshape(2, -1)
    pairs_b = _point_pairs(b, every[0], every[1], lengths, step)
    order = np.argsort(pairs_b.feature, kind='stable')
    features = pairs_b.feature[order]
    drawn = rng.integers(len(a), size=(2, 4 * _PAIRS))
    pairs_a = _point_pairs(a, drawn[0], drawn[1], lengths, step)
    first = np.searchsorted(features, pairs_a.feature[:_PAIRS])
    count = np.searchsorted(features, pairs_a.feature[:_PAIRS], side='right') - first
    pair = np.repeat(np.arange(len(count)), np.minimum(count, _MATCHES))
    match = order[first[pair] + (rng.random(len(pair)) * count[pair]).astype(np.int64)]
    for begin in range(0, len(pair), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        from_a, determined_a = pairs_a.frames(a, pair[part])
        from_b, determined_b = pairs_b.frames(b, match[part])
        determined = determined_a & determined_b
        yield from_b[determined] @ np.linalg.inv(from_a[determined])


class _OverlapScorer:
    """Computes how much of a surface lies on the target."""

    def __init__(self, *, target: ClampedSurface, step: float) -> None:
        self._normals = target.surfels.normals
        self._grid = NearestGrid.build(target.surfels.points_xyz, step / 2, 1.2 * step)

    def overlap(self, poses: Floats, surface: ClampedSurface) -> Floats:
        """Return (k,) fraction of the surface's points that lie on the target at each pose."""
        p, n = surface.surfels.points_xyz, surface.surfels.normals
        found = [np.empty(0)]
        for begin in range(0, len(poses), _CHUNK):
            T = poses[begin : begin + _CHUNK]
            R = np.swapaxes(T[:, :3, :3], 1, 2)
            index = self._grid.query(p @ R + T[:, None, :3, 3])
            compatible = ((n @ R) * self._normals[index]).sum(axis=-1) > _MIN_COSINE
            found.append((compatible & (index >= 0)).mean(axis=1))
        return np.concatenate(found)


def _random_sample(
    surface: ClampedSurface, count: int, rng: np.random.Generator
) -> ClampedSurface:
    return surface.selected(rng.permutation(len(surface))[:count])


def _best(poses: Floats, overlap: Floats, count: int) -> Floats:
    return np.asarray(poses[np.argsort(-overlap, kind='stable')[:count]])


def distinct_poses(
    poses: Floats, overlap: Floats, points_xyz: Floats, min_distance: float
) -> Ints:
    """
    Return the indices of the best poses that are distinct, the best first.

    min_distance : meters, greatest displacement of the points' bounding box between two poses
        that are taken for the same
    """
    corners = box_corners(points_xyz)
    moved = np.einsum('kij,cj->kci', poses[:, :3, :3], corners) + poses[:, None, :3, 3]
    remaining = np.argsort(-overlap, kind='stable')
    chosen: list[int] = []
    while len(remaining) and len(chosen) < _DISTINCT:
        best = int(remaining[0])
        chosen.append(best)
        distance = np.linalg.norm(moved[remaining] - moved[best], axis=2).max(axis=1)
        remaining = remaining[distance > min_distance]
    return np.array(chosen, dtype=np.int64)


def box_corners(points_xyz: Floats) -> Floats:
    """Return (8, 3) corners of the bounding box of (n, 3) points."""
    ends = np.stack([points_xyz.min(axis=0), points_xyz.max(axis=0)])
    return np.array(
        [[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
