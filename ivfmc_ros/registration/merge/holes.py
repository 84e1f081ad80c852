# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Round holes: circles fitted to line segments on their walls.

A hole is assumed to be drilled square to a plane face. Seen along the face's normal, its wall is
a circle; two scans that look into the two ends of a through hole see the same circle. The circle
is found by RANSAC (Fischler and Bolles 1981) and refined by Gauss-Newton.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.line_segments import LineSegments
from ivfmc_ros.registration.solver.surfels import Surfels

# Segments nearer than this are connected, and the accepted radii, in surfel spacings: a smaller
# hole has too few segments, the wall of a larger one has surfels.
_CONNECTED, _RADII = 2.5, (0.7, 6.0)
# Least number of segments on a wall, least arc they must cover, and least fraction of their
# connected component.
_MIN_SEGMENTS, _MIN_ARC, _MIN_FRACTION = 8, np.radians(40.0), 0.5
# A segment lies on the wall within this many sigmas of a point, and runs along it within this
# cosine between its direction and the radius.
_WALL_SIGMAS, _RADIAL_COSINE = 4.0, 0.35
# Random triples of segments that RANSAC draws.
_DRAWS = 200
# Normals with a greater cosine belong to one face direction, which needs this fraction of the
# surfels.
_SAME_DIRECTION, _MIN_FACE = 0.999, 0.05
_FIT_ITERATIONS = 10


@dataclass(frozen=True, eq=False, kw_only=True)
class Hole:
    """
    The visible part of a round hole.

    points_xyz : (n, 3) meters, centers of the line segments on its wall
    axis : (3,) unit vector
    center : (3,) meters, point on the axis
    radius : meters
    sigma : meters, 1 sigma of a measured point
    """

    points_xyz: Floats
    axis: Floats
    center: Floats
    radius: float
    sigma: float

    def transformed(self, T: Floats) -> 'Hole':
        """Return the hole transformed by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            axis=T[:3, :3] @ self.axis,
            center=transforms.apply(T, self.center[None])[0],
        )


def find_holes(segments: LineSegments, surfels: Surfels, spacing: float) -> tuple[Hole, ...]:
    """
    Return the round holes that are square to plane faces.

    segments : those that lie on no surfel
    spacing : of the surfels, meters
    """
    rng = np.random.default_rng(0)
    axes = _face_normals(surfels)
    holes: list[Hole] = []
    for component in _components(segments, spacing):
        found = [hole for axis in axes for hole in _fit_hole(axis, component, spacing, rng)]
        holes += sorted(found, key=lambda hole: -len(hole.points_xyz))[:1]
    return tuple(holes)


def _face_normals(surfels: Surfels) -> list[Floats]:
    """Return the normals of plane faces; opposite normals count as one direction."""
    remaining = surfels.normals
    axes: list[Floats] = []
    while len(remaining) > _MIN_FACE * len(surfels):
        # of some 200 normals the one that most others agree with
        candidates = remaining[:: max(1, len(remaining) // 200)]
        agrees = np.abs(candidates @ remaining.T) > _SAME_DIRECTION
        best = int(agrees.sum(axis=1).argmax())
        if agrees[best].sum() < _MIN_FACE * len(surfels):
            break
        same = remaining[agrees[best]]
        mean = (same * np.sign(same @ candidates[best])[:, None]).sum(axis=0)
        axes.append(mean / np.linalg.norm(mean))
        remaining = remaining[np.abs(remaining @ axes[-1]) <= _SAME_DIRECTION - 0.01]
    return axes


def _components(segments: LineSegments, spacing: float) -> Iterator[LineSegments]:
    """Yield the connected components of segments that are large enough for a hole."""
    if len(segments) < _MIN_SEGMENTS:
        return
    tree = cKDTree(segments.points_xyz)
    distances = tree.sparse_distance_matrix(
        cKDTree(segments.points_xyz), _CONNECTED * spacing, output_type='coo_matrix'
    )
    _, component = connected_components(distances, directed=False)
    for number in np.flatnonzero(np.bincount(component) >= _MIN_SEGMENTS):
        yield segments.selected(component == number)


def _fit_hole(
    axis: Floats, segments: LineSegments, spacing: float, rng: np.random.Generator
) -> Iterator[Hole]:
    """Yield the circle, seen along the axis, that most of the segments lie on, if there is one."""
    plane = _plane_basis(axis)
    q, directions, sight = (
        values @ plane for values in (segments.points_xyz, segments.directions, segments.sight)
    )
    centers, radii = _circles(q[rng.integers(len(q), size=(_DRAWS, 3))])
    usable = (radii > _RADII[0] * spacing) & (radii < _RADII[1] * spacing)
    centers, radii = centers[usable], radii[usable]
    if not len(radii):
        return
    limit = _WALL_SIGMAS * segments.sigma
    inliers = [
        _on_wall(q, directions, sight, c, r, limit) for c, r in zip(centers, radii, strict=True)
    ]
    best = int(np.argmax([mask.sum() for mask in inliers]))
    on_wall = inliers[best]
    center, radius = centers[best], float(radii[best])
    for _ in range(_FIT_ITERATIONS):
        if on_wall.sum() < _MIN_SEGMENTS:
            return
        center, radius = _gauss_newton_step(q[on_wall], center, radius)
        on_wall = _on_wall(q, directions, sight, center, radius, limit)
    if (
        on_wall.sum() < max(_MIN_SEGMENTS, _MIN_FRACTION * len(q))
        or not _RADII[0] * spacing < radius < _RADII[1] * spacing
    ):
        return
    outward = q[on_wall] - center
    if _covered_arc(np.arctan2(outward[:, 1], outward[:, 0])) < _MIN_ARC:
        return
    points = segments.points_xyz[on_wall]
    yield Hole(
        points_xyz=points,
        axis=axis,
        center=plane @ center + axis * float((points @ axis).mean()),
        radius=radius,
        sigma=segments.sigma,
    )


def _plane_basis(axis: Floats) -> Floats:
    """Return (3, 2) orthonormal columns that are perpendicular to an axis."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


def _circles(triples: Floats) -> tuple[Floats, Floats]:
    """Return the circles through (n, 3, 2) points: (n, 2) centers and (n,) radii."""
    a, b = triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0]
    area = 2.0 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    aa, bb = (a**2).sum(axis=1), (b**2).sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        x = (b[:, 1] * aa - a[:, 1] * bb) / area
        y = (a[:, 0] * bb - b[:, 0] * aa) / area
    offset = np.stack([x, y], axis=1)
    radii = np.linalg.norm(offset, axis=1)
    return triples[:, 0] + offset, np.where(np.isfinite(radii), radii, np.inf)


def _on_wall(
    q: Floats, directions: Floats, sight: Floats, center: Floats, radius: float, limit: float
) -> Bools:
    """Return which segments lie on a circle, along its wall, and are seen from inside."""
    outward = q - center
    distance = np.linalg.norm(outward, axis=1)
    outward = outward / np.maximum(distance, 1e-9)[:, None]
    return np.asarray(
        (np.abs(distance - radius) < limit)
        & (np.abs((outward * directions).sum(axis=1)) < _RADIAL_COSINE)
        & ((outward * sight).sum(axis=1) < 0.0)
    )


def _gauss_newton_step(q: Floats, center: Floats, radius: float) -> tuple[Floats, float]:
    """Return center and radius of a circle after a Gauss-Newton step to (n, 2) points."""
    outward = q - center
    distance = np.linalg.norm(outward, axis=1)
    J = np.column_stack([outward / distance[:, None], np.ones(len(q))])
    step = np.linalg.lstsq(J, distance - radius, rcond=1e-6)[0]
    return center + step[:2], radius + float(step[2])


def _covered_arc(angles: Floats) -> float:
    """Return the shortest arc that contains all angles, radians."""
    angles = np.sort(angles)
    return float(2.0 * np.pi - np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max())
