# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which patches of two views are the same piece of surface."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.surfels import Patches

_ALIKE = 0.8  # cosine between the normals of a pair
# A partner lies within so many patch spacings along the surface; beyond is another border.
_ASIDE = 1.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Pairs:
    """
    Pairs of patches of view ``a`` and view ``b``, in the frame ``turntable``.

    i, j : (n,) index of the patch in its view
    middle : (n, 3) metres; gap : (n, 3) metres, from b's patch to a's
    normals_a, normals_b : (n, 3) unit; sigma : (n,) metres, of the gap along the normal
    """

    a: int
    b: int
    i: Ints
    j: Ints
    middle: Floats
    gap: Floats
    normals_a: Floats
    normals_b: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.i)

    @property
    def normals(self) -> Floats:
        """
        (n, 3) unit, between the two normals.

        With it the gap of two points of one circle is zero, wherever they lie on it: the
        symmetric objective of Rusinkiewicz 2019.
        """
        both = self.normals_a + self.normals_b
        return np.asarray(both / np.linalg.norm(both, axis=1, keepdims=True))

    @property
    def residuals(self) -> Floats:
        """(n,) metres, the gap along the normal."""
        return np.asarray((self.gap * self.normals).sum(axis=1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Reach:
    """How far apart partners may be, metres: along the normal, and along the surface."""

    gap: float
    aside: float


def reach_of(gap: float, edge: float) -> Reach:
    """Return the reach for patches ``edge`` metres apart."""
    return Reach(gap=gap, aside=_ASIDE * edge)


def match(
    number: tuple[int, int],
    views: tuple[Patches, Patches],
    poses: tuple[Floats, Floats],
    reach: Reach,
    every: int = 1,
) -> Pairs:
    """
    Return for the patches of one view those of the other that are nearest and alike.

    every : take only each so many-th patch of the first view
    """
    (patches_a, patches_b), (T_a, T_b) = views, poses
    i = np.arange(0, len(patches_a), every)
    here = transforms.apply(T_a, patches_a.points_xyz[i])
    limit = float(np.hypot(reach.gap, reach.aside))
    inside = transforms.apply(transforms.invert(T_b), here)
    distance, j = patches_b.tree.query(inside, distance_upper_bound=limit)
    near = np.isfinite(distance)
    i, j, here = i[near], j[near], here[near]
    there = transforms.apply(T_b, patches_b.points_xyz[j])
    pairs = Pairs(
        a=number[0],
        b=number[1],
        i=i,
        j=j.astype(np.int64),
        middle=(here + there) / 2,
        gap=here - there,
        normals_a=patches_a.normals[i] @ T_a[:3, :3].T,
        normals_b=patches_b.normals[j] @ T_b[:3, :3].T,
        sigma=np.hypot(patches_a.sigma[i], patches_b.sigma[j]),
    )
    return _sound(pairs, reach)


def _sound(pairs: Pairs, reach: Reach) -> Pairs:
    along = pairs.residuals
    aside = np.sqrt(np.maximum((pairs.gap**2).sum(axis=1) - along**2, 0.0))
    alike = (pairs.normals_a * pairs.normals_b).sum(axis=1) > _ALIKE
    return chosen(
        pairs, np.flatnonzero(alike & (np.abs(along) < reach.gap) & (aside < reach.aside))
    )


def chosen(pairs: Pairs, which: Ints) -> Pairs:
    """Return some of the pairs."""
    arrays = ('i', 'j', 'middle', 'gap', 'normals_a', 'normals_b', 'sigma')
    return Pairs(a=pairs.a, b=pairs.b, **{name: getattr(pairs, name)[which] for name in arrays})
