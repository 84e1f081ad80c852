# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Correspondences between the surfels of two views: nearest neighbors with similar normals."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.surfels import Surfels

# Least cosine between the normals of a correspondence (37 degrees): rejects the two sides of a
# thin wall and of an edge.
_MIN_NORMAL_COSINE = 0.8
# Greatest distance of a correspondence along the surface, in surfel spacings. A neighbor that is
# farther aside is the border of a view that ends there.
_MAX_TANGENTIAL_SPACINGS = 1.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Correspondences:
    """
    Corresponding surfels of view ``a`` and view ``b``, in the frame ``turntable``.

    a, b : index of each view
    index_a, index_b : (n,) int, index of the surfel in its view
    midpoint : (n, 3) meters, between the two surfels
    difference : (n, 3) meters, from b's surfel to a's
    normals_a, normals_b : (n, 3) unit
    sigma : (n,) meters, of the distance along the normal
    """

    a: int
    b: int
    index_a: Ints
    index_b: Ints
    midpoint: Floats
    difference: Floats
    normals_a: Floats
    normals_b: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.index_a)

    @property
    def normals(self) -> Floats:
        """
        (n, 3) unit, the bisector of the two normals.

        With it the residual of two points of one circle is zero, wherever they lie on it: the
        symmetric objective of Rusinkiewicz 2019, "A symmetric objective function for ICP".
        """
        both = self.normals_a + self.normals_b
        return np.asarray(both / np.linalg.norm(both, axis=1, keepdims=True))

    @property
    def residuals(self) -> Floats:
        """(n,) meters, the signed point-to-plane distance."""
        return np.asarray((self.difference * self.normals).sum(axis=1))


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchWindow:
    """Maximum correspondence distance, meters, along the normal and along the surface."""

    normal: float
    tangential: float


def search_window(max_distance: float, spacing: float) -> SearchWindow:
    """
    Return the search window for surfels that are ``spacing`` meters apart.

    max_distance : meters, along the normal
    """
    return SearchWindow(normal=max_distance, tangential=_MAX_TANGENTIAL_SPACINGS * spacing)


def find_correspondences(
    number: tuple[int, int],
    views: tuple[Surfels, Surfels],
    poses: tuple[Floats, Floats],
    window: SearchWindow,
    stride: int = 1,
) -> Correspondences:
    """
    Find for each surfel of the first view the nearest surfel of the second.

    Correspondences whose normals differ, or whose distance exceeds the window, are rejected.

    number : indices of the two views
    poses : (4, 4) turntable_from_view of each
    stride : use every stride-th surfel of the first view
    """
    (surfels_a, surfels_b), (T_a, T_b) = views, poses
    index_a = np.arange(0, len(surfels_a), stride)
    points_a = transforms.apply(T_a, surfels_a.points_xyz[index_a])
    radius = float(np.hypot(window.normal, window.tangential))
    query = transforms.apply(transforms.invert(T_b), points_a)
    distance, index_b = surfels_b.tree.query(query, distance_upper_bound=radius)
    near = np.isfinite(distance)
    index_a, index_b, points_a = index_a[near], index_b[near], points_a[near]
    points_b = transforms.apply(T_b, surfels_b.points_xyz[index_b])
    found = Correspondences(
        a=number[0],
        b=number[1],
        index_a=index_a,
        index_b=index_b.astype(np.int64),
        midpoint=(points_a + points_b) / 2,
        difference=points_a - points_b,
        normals_a=surfels_a.normals[index_a] @ T_a[:3, :3].T,
        normals_b=surfels_b.normals[index_b] @ T_b[:3, :3].T,
        sigma=np.hypot(surfels_a.sigma[index_a], surfels_b.sigma[index_b]),
    )
    return _reject(found, window)


def _reject(found: Correspondences, window: SearchWindow) -> Correspondences:
    normal = found.residuals
    tangential = np.sqrt(np.maximum((found.difference**2).sum(axis=1) - normal**2, 0.0))
    cosine = (found.normals_a * found.normals_b).sum(axis=1)
    kept = (
        (cosine > _MIN_NORMAL_COSINE)
        & (np.abs(normal) < window.normal)
        & (tangential < window.tangential)
    )
    return _select(found, np.flatnonzero(kept))


def _select(found: Correspondences, which: Ints) -> Correspondences:
    """Return some of the correspondences."""
    arrays = (
        'index_a',
        'index_b',
        'midpoint',
        'difference',
        'normals_a',
        'normals_b',
        'sigma',
    )
    return Correspondences(
        a=found.a, b=found.b, **{name: getattr(found, name)[which] for name in arrays}
    )
