# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surfels of a downsampled view: points with a normal and uncertainty, from local quadrics."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.downsample import DownsampledView

# Neighbors of a fit: at most, and at least (a quadric has six coefficients).
_NEIGHBORS = 16
_MIN_NEIGHBORS = 9
_SEARCH_RADIUS = 3.5  # in sample spacings
# Least ratio of the neighbors' two in-plane variances: below it they lie on a line, which has no
# normal.
_MIN_ASPECT = 0.08
# Largest weight of a single sample in the surfel's height: above it the fit is that one sample.
_MAX_WEIGHT = 0.9
# A fit whose residual exceeds the view's median by this factor lies on an edge.
_MAX_ROUGHNESS = 3.0
# Surfels fitted at a time, which bounds the memory.
_CHUNK = 20_000
_ARRAYS = ('points_xyz', 'normals', 'sigma', 'sample', 'members', 'weights')


@dataclass(frozen=True, eq=False, kw_only=True)
class Surfels:
    """
    Surface elements of one view.

    points_xyz : (n, 3) meters, on the fitted surface
    normals : (n, 3) unit, to the seen side
    sigma : (n,) meters, of the point along the normal
    sample : (n,) index of the sample at which the surfel was fitted
    members, weights : (n, k) samples of the fit, and their weights in the surfel's height along
        its normal
    """

    points_xyz: Floats
    normals: Floats
    sigma: Floats
    sample: Ints
    members: Ints
    weights: Floats

    def __len__(self) -> int:
        return len(self.points_xyz)

    @cached_property
    def tree(self) -> cKDTree:
        """A k-d tree of the points."""
        return cKDTree(self.points_xyz)

    def transformed(self, T: Floats) -> 'Surfels':
        """Return the surfels moved by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            normals=self.normals @ T[:3, :3].T,
        )

    def select(self, which: Ints | Bools) -> 'Surfels':
        """Return the surfels of an index or mask."""
        return Surfels(**{name: getattr(self, name)[which] for name in _ARRAYS})

    def displaced(self, offset: Floats) -> 'Surfels':
        """Return the surfels with (n, 3) meters added to their points."""
        return replace(self, points_xyz=self.points_xyz + offset)


def fit_surfels(samples: DownsampledView, spacing: float) -> Surfels:
    """
    Fit a quadric to the neighbors of every sample.

    Samples at edges, on lines and without neighbors give no surfel. A quadric, because a plane
    through the neighbors on a shaft lies inside of it.

    spacing : meters, between samples
    """
    tree = cKDTree(samples.points_xyz) if len(samples) else None
    chunks = [
        _fit(samples, np.arange(first, min(first + _CHUNK, len(samples))), spacing, tree)
        for first in range(0, len(samples), _CHUNK)
    ]
    if not chunks:
        return _empty()
    roughness = np.concatenate([chunk[1] for chunk in chunks])
    valid = np.concatenate([chunk[2] for chunk in chunks])
    median = np.median(roughness[valid]) if valid.any() else 0.0
    smooth = valid & (roughness <= _MAX_ROUGHNESS * median + 1e-9)
    return concatenate_surfels([chunk[0] for chunk in chunks]).select(smooth)


def _fit(
    samples: DownsampledView, center: Ints, spacing: float, tree: cKDTree | None
) -> tuple[Surfels, Floats, Bools]:
    """Return the surfels at some samples, the rms residual of each fit (meters), and validity."""
    points = samples.points_xyz
    distance, members = (tree or cKDTree(points)).query(
        points[center], k=_NEIGHBORS, distance_upper_bound=_SEARCH_RADIUS * spacing
    )
    known = np.isfinite(distance)
    members = np.where(known, members, center[:, None])
    ratio = np.minimum(distance, 1e9) / (_SEARCH_RADIUS * spacing)
    window = np.where(known, (1 - ratio**2) ** 2, 0.0)
    local = (points[members] - points[center][:, None]) / spacing
    frame, linear = _frames(local, window, samples.outward[center])
    in_frame = local @ frame
    weights, gradient, roughness = _quadric(in_frame, window)
    height = (weights * in_frame[:, :, 2]).sum(axis=1)
    normals = frame[:, :, 2] - np.einsum('nd,ncd->nc', gradient, frame[:, :, :2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surfels = Surfels(
        points_xyz=points[center] + spacing * height[:, None] * frame[:, :, 2],
        normals=normals,
        sigma=np.sqrt(((weights * samples.sigma[members]) ** 2).sum(axis=1)),
        sample=center,
        members=members,
        weights=weights,
    )
    enough = known.sum(axis=1) >= _MIN_NEIGHBORS
    valid = enough & ~linear & (np.abs(weights).max(axis=1) < _MAX_WEIGHT)
    return surfels, spacing * roughness, valid


def _frames(local: Floats, window: Floats, outward: Floats) -> tuple[Floats, Bools]:
    """Return (n, 3, 3) axes in columns, the normal last, and which neighborhoods are lines."""
    mean = (window[..., None] * local).sum(axis=1) / window.sum(axis=1)[:, None]
    centered = local - mean[:, None]
    moment = np.swapaxes(centered * window[..., None], 1, 2) @ centered
    variance, axes = np.linalg.eigh(moment)
    frame = axes[:, :, [2, 1, 0]]
    inward = (frame[:, :, 2] * outward).sum(axis=1) < 0
    frame[inward] *= -1.0
    return frame, variance[:, 1] < _MIN_ASPECT * variance[:, 2]


def _quadric(local: Floats, window: Floats) -> tuple[Floats, Floats, Floats]:
    """
    Fit z = c0 + c1 x + c2 y + c3 x^2 + c4 x y + c5 y^2 to (n, k, 3) points.

    returns : (n, k) weights with c0 = sum w z, (n, 2) gradient c1, c2, (n,) rms residual
    """
    x, y, z = np.moveaxis(local, 2, 0)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    weighted = basis * window[..., None]
    transposed = np.swapaxes(weighted, 1, 2)
    # the ridge only matters where there are too few neighbors, which give no surfel
    normal_matrix = transposed @ basis + 1e-9 * np.eye(6)
    # the inverse is symmetric: its first row is its first column
    right_sides = np.concatenate(
        [np.broadcast_to(np.eye(6)[:, :1], (len(z), 6, 1)), transposed @ z[..., None]], axis=2
    )
    row, coefficients = np.moveaxis(np.linalg.solve(normal_matrix, right_sides), 2, 0)
    residual = z - (basis @ coefficients[..., None])[..., 0]
    rms = np.sqrt((window * residual**2).sum(axis=1) / window.sum(axis=1))
    return (weighted @ row[..., None])[..., 0], coefficients[:, 1:3], rms


def concatenate_surfels(parts: Sequence[Surfels]) -> Surfels:
    """Return all surfels as one set; ``sample`` and ``members`` keep the indices of each view."""
    return Surfels(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    )


def _empty() -> Surfels:
    return Surfels(
        points_xyz=np.empty((0, 3)),
        normals=np.empty((0, 3)),
        sigma=np.empty(0),
        sample=np.empty(0, dtype=np.int64),
        members=np.empty((0, _NEIGHBORS), dtype=np.int64),
        weights=np.empty((0, _NEIGHBORS)),
    )
