# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The normal equations of all pairs of all views, in six unknowns a view and those of the cell."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.correspondences import Pairs

DOF = 6  # rotation vector (radians) about the frame's origin, translation (metres)

# Pairs in one cube of this edge err together: their noise is counted once.
_CLUSTER = 5.0  # in patch spacings
# Whole regions of this edge are displaced together.
_REGION = 20.0
# Residuals of so many sigmas are no outliers.
_ROBUST = 2.5

# (view, (n, 3) points, (n,) patches near them) -> (n, C, 3) metres per unknown of the cell
SlopesAt = Callable[[int, Floats, Ints], Floats]


@dataclass(frozen=True, eq=False, kw_only=True)
class Slopes:
    """
    How the points of every view move with the unknowns of the cell.

    of_patches : of each view, (n, C, 3) metres per unknown
    at : the same anywhere on the surface. Both views of a pair are asked at one point: between
        two patches, even a millimetre apart, the table angle differs by what would pass for news
    """

    of_patches: Sequence[Floats]
    at: SlopesAt

    @property
    def unknowns(self) -> int:
        """How many there are."""
        return self.of_patches[0].shape[1] if self.of_patches else 0


@dataclass(frozen=True, kw_only=True)
class Noise:
    """
    How residuals scatter.

    scale : by which they exceed their claimed sigmas
    width : metres; beyond it, and beyond what scale and sigma explain, a pair is an outlier
    lasting : share of a patch's sigma by which whole regions are displaced
    """

    scale: float
    width: float
    lasting: float


@dataclass(frozen=True, eq=False, kw_only=True)
class System:
    """
    What pairs say about ``6 views + C`` unknowns.

    The noise of normals pretends to information: any surface seems to have some about any
    motion. The normals of the two patches of a pair err independently, so that their product is
    free of it.

    information : J_a' W J_b, from the normals of the one side times those of the other
    curvature : J' W J from the normals between the two, with the noise: by how much the gradient
        really changes
    gradient : - J' W r
    scatter : the gradient's variance as found, from clusters of pairs that err together, and
        of what patches have wrong over whole regions
    """

    information: Floats
    curvature: Floats
    gradient: Floats
    scatter: Floats


def robust_scale(blocks: Sequence[Pairs]) -> float:
    """Return the robust standard deviation of residual over sigma; 1 if there are no pairs."""
    left = [np.abs(pairs.residuals) / pairs.sigma for pairs in blocks if len(pairs)]
    return max(1.4826 * float(np.median(np.concatenate(left))), 1e-3) if left else 1.0


def assemble(
    blocks: Sequence[Pairs], slopes: Slopes | None, views: int, noise: Noise, edge: float | None
) -> System:
    """
    Build the normal equations.

    edge : metres, between patches; None while the residuals are the error that is looked for,
        from which the scatter of noise cannot be told
    """
    size = DOF * views + (slopes.unknowns if slopes else 0)
    total = [np.zeros((size, size)) for _ in range(3)]
    gradient = np.zeros(size)
    for pairs in blocks:
        if not len(pairs):
            continue
        where = _columns(pairs, size, views)
        square = np.ix_(where, where)
        part = _of_pairs(pairs, slopes, noise, edge)
        for sums, one in zip(total, (part.information, part.curvature, part.scatter), strict=True):
            sums[square] += one
        gradient[where] += part.gradient
    return System(information=total[0], curvature=total[1], gradient=gradient, scatter=total[2])


def _of_pairs(pairs: Pairs, slopes: Slopes | None, noise: Noise, edge: float | None) -> System:
    """Return the normal equations of the pairs of two views, in their 12 + C unknowns."""
    weight = robust_weight(pairs, noise)[:, None]
    differ = _differences(pairs, slopes)
    one = jacobian(pairs, pairs.normals_a, differ)
    other = jacobian(pairs, pairs.normals_b, differ)
    both = (one + other) * (0.5 * np.sqrt(weight))
    cross = (one * weight).T @ other
    score = -both * (pairs.residuals[:, None] * np.sqrt(weight))
    curvature = both.T @ both
    return System(
        information=(cross + cross.T) / 2,
        curvature=curvature,
        gradient=score.sum(axis=0),
        scatter=curvature
        if edge is None
        else _scatter(pairs, score, both, weight, edge, noise.lasting),
    )


def _scatter(
    pairs: Pairs, score: Floats, both: Floats, weight: Floats, edge: float, share: float
) -> Floats:
    clusters = _by_cluster(score, pairs.middle, _CLUSTER * edge)
    lasting = both * (share * pairs.sigma[:, None] * np.sqrt(weight))
    regions = _by_cluster(lasting, pairs.middle, _REGION * edge)
    return np.asarray(clusters.T @ clusters + regions.T @ regions)


def robust_weight(pairs: Pairs, noise: Noise) -> Floats:
    """Return (n,) weights in 1/metre^2 (Geman and McClure 1987)."""
    spread = pairs.sigma * max(noise.scale, 1.0)
    far = pairs.residuals / np.maximum(_ROBUST * pairs.sigma * noise.scale, noise.width)
    return np.asarray(1.0 / (spread**2 * (1.0 + far**2) ** 2))


def jacobian(pairs: Pairs, normals: Floats, differ: Floats | None) -> Floats:
    """
    Return (n, 12 + C): how residuals change with the pose of a, of b, and the cell.

    differ : (n, C, 3) metres per unknown of the cell by which a's point moves more than b's
    """
    moves = np.hstack([np.cross(pairs.middle, normals), normals])
    if differ is None:
        return np.hstack([moves, -moves])
    return np.hstack([moves, -moves, np.einsum('ncd,nd->nc', differ, normals)])


def _differences(pairs: Pairs, slopes: Slopes | None) -> Floats | None:
    if slopes is None or not slopes.unknowns:
        return None
    one = slopes.at(pairs.a, pairs.middle, pairs.i)
    return np.asarray(one - slopes.at(pairs.b, pairs.middle, pairs.j))


def _columns(pairs: Pairs, size: int, views: int) -> Ints:
    a, b = DOF * pairs.a, DOF * pairs.b
    return np.concatenate(
        [np.arange(a, a + DOF), np.arange(b, b + DOF), np.arange(DOF * views, size)]
    )


def _by_cluster(score: Floats, middle: Floats, edge: float) -> Floats:
    """Return the sums of (n, m) scores over cubes of ``edge`` metres."""
    cube = np.floor((middle - middle.min(axis=0)) / edge).astype(np.int64)
    shape = cube.max(axis=0) + 1
    key = (cube[:, 0] * shape[1] + cube[:, 1]) * shape[2] + cube[:, 2]
    order = np.argsort(key, kind='stable')
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return np.asarray(np.add.reduceat(score[order], starts, axis=0))
