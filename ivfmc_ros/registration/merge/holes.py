# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Round holes: narrow walls that say where they are better than any patch of theirs would.

A hole is drilled square to a plane face. Its wall is a circle along that face's normal, and what
one scan sees of one end and another scan of the other end is the same circle.
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
from ivfmc_ros.registration.merge.line_segments import Strokes
from ivfmc_ros.registration.solver.surfels import Patches

# Strokes this near hang together, and radii of holes, in patch spacings.
_LINK, _RADII = 2.5, (0.7, 6.0)
# A wall needs so many strokes, over so much of the circle.
_LEAST, _ARC = 8, np.radians(40.0)
# And most of what hangs together.
_MOST_OF = 0.5
# They lie on it within so many sigmas of a point, and run along it.
_WITHIN, _ALONG = 4.0, 0.35
_DRAWS = 200
# Faces whose normals are alike (cosine) are one direction; it counts with this share of patches.
_ONE, _SHARE = 0.999, 0.05
_FIT_ROUNDS = 10


@dataclass(frozen=True, eq=False, kw_only=True)
class Bore:
    """
    What is seen of a round hole.

    points_xyz : (n, 3) metres, of its wall; axis : (3,) unit; centre : (3,) metres, on the axis
    radius : metres; sigma : metres, of a point
    """

    points_xyz: Floats
    axis: Floats
    centre: Floats
    radius: float
    sigma: float

    def moved(self, T: Floats) -> 'Bore':
        """Return the hole moved by a rigid (4, 4) matrix."""
        return replace(
            self,
            points_xyz=transforms.apply(T, self.points_xyz),
            axis=T[:3, :3] @ self.axis,
            centre=transforms.apply(T, self.centre[None])[0],
        )


def find_bores(strokes: Strokes, patches: Patches, edge: float) -> tuple[Bore, ...]:
    """
    Return the round holes square to plane faces.

    strokes : those that lie on no patch; edge : metres, between patches
    """
    rng = np.random.default_rng(0)
    axes = _face_directions(patches)
    found: list[Bore] = []
    for part in _pieces(strokes, edge):
        bores = [bore for axis in axes for bore in _bores_along(axis, part, edge, rng)]
        found += sorted(bores, key=lambda bore: -len(bore.points_xyz))[:1]
    return tuple(found)


def _face_directions(patches: Patches) -> list[Floats]:
    """Return the normals of what is plane, either sense as one."""
    left = patches.normals
    axes: list[Floats] = []
    while len(left) > _SHARE * len(patches):
        # the direction that most of some have
        asked = left[:: max(1, len(left) // 200)]
        alike = np.abs(asked @ left.T) > _ONE
        best = int(alike.sum(axis=1).argmax())
        if alike[best].sum() < _SHARE * len(patches):
            break
        same = left[alike[best]]
        mean = (same * np.sign(same @ asked[best])[:, None]).sum(axis=0)
        axes.append(mean / np.linalg.norm(mean))
        left = left[np.abs(left @ axes[-1]) <= _ONE - 0.01]
    return axes


def _pieces(strokes: Strokes, edge: float) -> Iterator[Strokes]:
    """Give the strokes that hang together."""
    if len(strokes) < _LEAST:
        return
    near = cKDTree(strokes.points_xyz).sparse_distance_matrix(
        cKDTree(strokes.points_xyz), _LINK * edge, output_type='coo_matrix'
    )
    _, piece = connected_components(near, directed=False)
    for number in np.flatnonzero(np.bincount(piece) >= _LEAST):
        yield strokes.chosen(piece == number)


def _bores_along(
    axis: Floats, strokes: Strokes, edge: float, rng: np.random.Generator
) -> Iterator[Bore]:
    """Give the circle that most of the strokes lie on, seen along the axis."""
    across = _across(axis)
    q, way, sight = (
        values @ across for values in (strokes.points_xyz, strokes.ways, strokes.sight)
    )
    drawn = q[rng.integers(len(q), size=(_DRAWS, 3))]
    centres, radii = _circles(drawn)
    usable = (radii > _RADII[0] * edge) & (radii < _RADII[1] * edge)
    centres, radii = centres[usable], radii[usable]
    if not len(radii):
        return
    limit = _WITHIN * strokes.sigma
    on = [_on_wall(q, way, sight, c, r, limit) for c, r in zip(centres, radii, strict=True)]
    best = int(np.argmax([one.sum() for one in on]))
    chosen = on[best]
    centre, radius = centres[best], float(radii[best])
    for _ in range(_FIT_ROUNDS):
        if chosen.sum() < _LEAST:
            return
        centre, radius = _fitted(q[chosen], centre, radius)
        chosen = _on_wall(q, way, sight, centre, radius, limit)
    if (
        chosen.sum() < max(_LEAST, _MOST_OF * len(q))
        or not _RADII[0] * edge < radius < _RADII[1] * edge
    ):
        return
    out = q[chosen] - centre
    if _arc(np.arctan2(out[:, 1], out[:, 0])) < _ARC:
        return
    points = strokes.points_xyz[chosen]
    yield Bore(
        points_xyz=points,
        axis=axis,
        centre=across @ centre + axis * float((points @ axis).mean()),
        radius=radius,
        sigma=strokes.sigma,
    )


def _across(axis: Floats) -> Floats:
    """Return (3, 2) unit columns square to an axis and to each other."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


def _circles(triples: Floats) -> tuple[Floats, Floats]:
    """Return the circles through (n, 3, 2) points: (n, 2) centres and (n,) radii."""
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
    q: Floats, way: Floats, sight: Floats, centre: Floats, radius: float, limit: float
) -> Bools:
    """Return which strokes lie on the inside of a circle, and run along its wall."""
    out = q - centre
    distance = np.linalg.norm(out, axis=1)
    out = out / np.maximum(distance, 1e-9)[:, None]
    return np.asarray(
        (np.abs(distance - radius) < limit)
        & (np.abs((out * way).sum(axis=1)) < _ALONG)
        & ((out * sight).sum(axis=1) < 0.0)
    )


def _fitted(q: Floats, centre: Floats, radius: float) -> tuple[Floats, float]:
    """Return the circle after a Gauss-Newton step to (n, 2) points."""
    out = q - centre
    distance = np.linalg.norm(out, axis=1)
    J = np.column_stack([out / distance[:, None], np.ones(len(q))])
    step = np.linalg.lstsq(J, distance - radius, rcond=1e-6)[0]
    return centre + step[:2], radius + float(step[2])


def _arc(angles: Floats) -> float:
    """Return the shortest arc that holds all angles, radians."""
    angles = np.sort(angles)
    return float(2.0 * np.pi - np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max())
