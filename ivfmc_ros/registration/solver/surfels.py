# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small pieces of surface: a point, a normal, and how well both are known."""

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
from ivfmc_ros.registration.solver.downsample import Samples

_NEIGHBOURS = 16
_LEAST = 9  # a quadric has six coefficients
_RADIUS = 3.5  # in edges of the samples
# The neighbours' spread across over along; less is a line, which has no normal.
_SLIM = 0.08
# A patch this much rougher than usual lies on an edge.
_ROUGH = 3.0
_CHUNK = 20_000
_ARRAYS = ('points_xyz', 'normals', 'sigma', 'sample', 'members', 'weights')


@dataclass(frozen=True, eq=False, kw_only=True)
class Patches:
    """
    Pieces of surface of one view.

    points_xyz : (n, 3) metres, on the surface; normals : (n, 3) unit, to the seen side
    sigma : (n,) metres, of the point along the normal
    sample : (n,) index of the sample at which the patch was fitted
    members, weights : (n, k) samples and their share in the patch's height along its normal
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

    def posed(self, T: Floats) -> 'Patches':
        """Return the patches moved by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            normals=self.normals @ T[:3, :3].T,
        )

    def chosen(self, which: Ints | Bools) -> 'Patches':
        """Return some of the patches."""
        return Patches(**{name: getattr(self, name)[which] for name in _ARRAYS})

    def moved(self, offset: Floats) -> 'Patches':
        """Return the patches with (n, 3) metres added to their points."""
        return replace(self, points_xyz=self.points_xyz + offset)


def fit_patches(samples: Samples, edge: float) -> Patches:
    """
    Fit a quadric to the neighbours of every sample; leave out edges, lines and lone samples.

    A quadric and not a plane, because a plane through the neighbours on a shaft lies inside of
    it. edge : metres, between samples
    """
    tree = cKDTree(samples.points_xyz) if len(samples) else None
    parts = [
        _fit(samples, np.arange(first, min(first + _CHUNK, len(samples))), edge, tree)
        for first in range(0, len(samples), _CHUNK)
    ]
    if not parts:
        return _none()
    rough = np.concatenate([part[1] for part in parts])
    kept = np.concatenate([part[2] for part in parts])
    usual = np.median(rough[kept]) if kept.any() else 0.0
    sound = kept & (rough <= _ROUGH * usual + 1e-9)
    return joined([part[0] for part in parts]).chosen(sound)


def _fit(
    samples: Samples, centre: Ints, edge: float, tree: cKDTree | None
) -> tuple[Patches, Floats, Bools]:
    """Return the patches at some samples, how rough each is in metres, and which are sound."""
    points = samples.points_xyz
    distance, members = (tree or cKDTree(points)).query(
        points[centre], k=_NEIGHBOURS, distance_upper_bound=_RADIUS * edge
    )
    known = np.isfinite(distance)
    members = np.where(known, members, centre[:, None])
    window = np.where(known, (1 - (np.minimum(distance, 1e9) / (_RADIUS * edge)) ** 2) ** 2, 0.0)
    local = (points[members] - points[centre][:, None]) / edge
    frame, slim = _frames(local, window, samples.outward[centre])
    in_frame = local @ frame
    weights, slopes, rough = _quadric(in_frame, window)
    height = (weights * in_frame[:, :, 2]).sum(axis=1)
    normals = frame[:, :, 2] - np.einsum('nd,ncd->nc', slopes, frame[:, :, :2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    patches = Patches(
        points_xyz=points[centre] + edge * height[:, None] * frame[:, :, 2],
        normals=normals,
        sigma=np.sqrt(((weights * samples.sigma[members]) ** 2).sum(axis=1)),
        sample=centre,
        members=members,
        weights=weights,
    )
    sound = (known.sum(axis=1) >= _LEAST) & ~slim & (np.abs(weights).max(axis=1) < 0.9)
    return patches, edge * rough, sound


def _frames(local: Floats, window: Floats, outward: Floats) -> tuple[Floats, Bools]:
    """Return (n, 3, 3) axes in columns, the normal last, and which neighbours are a line."""
    mean = (window[..., None] * local).sum(axis=1) / window.sum(axis=1)[:, None]
    spread = local - mean[:, None]
    moment = np.swapaxes(spread * window[..., None], 1, 2) @ spread
    size, axes = np.linalg.eigh(moment)
    frame = axes[:, :, [2, 1, 0]]
    inward = (frame[:, :, 2] * outward).sum(axis=1) < 0
    frame[inward] *= -1.0
    return frame, size[:, 1] < _SLIM * size[:, 2]


def _quadric(local: Floats, window: Floats) -> tuple[Floats, Floats, Floats]:
    """
    Fit z = c0 + c1 x + c2 y + c3 x^2 + c4 x y + c5 y^2 to (n, k, 3) points.

    returns : (n, k) weights with c0 = sum w z, (n, 2) slopes c1, c2, (n,) rms of what is left
    """
    x, y, z = np.moveaxis(local, 2, 0)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    weighted = basis * window[..., None]
    across = np.swapaxes(weighted, 1, 2)
    # the ridge only bites where there are too few neighbours, which are left out anyway
    normal = across @ basis + 1e-9 * np.eye(6)
    # the inverse is symmetric: its first row is its first column
    asked = np.concatenate(
        [np.broadcast_to(np.eye(6)[:, :1], (len(z), 6, 1)), across @ z[..., None]], axis=2
    )
    row, coefficients = np.moveaxis(np.linalg.solve(normal, asked), 2, 0)
    left = z - (basis @ coefficients[..., None])[..., 0]
    rough = np.sqrt((window * left**2).sum(axis=1) / window.sum(axis=1))
    return (weighted @ row[..., None])[..., 0], coefficients[:, 1:3], rough


def joined(parts: Sequence[Patches]) -> Patches:
    """Return all patches in one; samples and members stay those of each view."""
    return Patches(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    )


def _none() -> Patches:
    return Patches(
        points_xyz=np.empty((0, 3)),
        normals=np.empty((0, 3)),
        sigma=np.empty(0),
        sample=np.empty(0, dtype=np.int64),
        members=np.empty((0, _NEIGHBOURS), dtype=np.int64),
        weights=np.empty((0, _NEIGHBOURS)),
    )
