# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closed solids from planar outlines extruded and stacked along z."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.spatial import Delaunay

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.parts.loading import Solid

# Greatest distance in meters of a chord from the arc that it approximates.
CHORD = 1e-6

# Greatest length in meters of an edge, so that the Delaunay triangulation contains the outline.
_MAX_EDGE = 1e-3
_WELD_DISTANCE = 1e-9  # meters; vertices nearer than this are merged

Outline = Sequence[Floats]


@dataclass(frozen=True, eq=False, kw_only=True)
class Layer:
    """
    Material between two heights.

    bottom, top : outlines (n, 2) in meters with the material on their left: the outer one
        counter-clockwise, holes clockwise. Point i of a bottom outline is joined to point i of
        the top one; without ``top`` the walls are upright
    """

    low: float
    high: float
    bottom: Outline
    top: Outline | None = None

    @property
    def upper(self) -> Outline:
        """The outlines (n, 2) at ``high``."""
        return self.bottom if self.top is None else self.top


def stack(layers: Sequence[Layer]) -> Solid:
    """
    Join layers, each on top of the one before, to one solid.

    Outlines of neighboring layers may share points or lie apart, but must not cross.

    :raises GeometryError: the solid is not closed: outlines cross or have the wrong orientation
    """
    triangles = [_walls(layer) for layer in layers]
    below: list[Outline] = [[], *(layer.upper for layer in layers)]
    above: list[Outline] = [*(layer.bottom for layer in layers), []]
    heights = [layers[0].low, *(layer.high for layer in layers)]
    for outline, next_outline, height in zip(below, above, heights, strict=True):
        triangles += _caps(outline, next_outline, height)
    solid = _weld(np.concatenate(triangles))
    if not solid.watertight or solid.volume <= 0:
        raise GeometryError('the outlines do not close: they cross, or run the wrong way round')
    return solid


def circle_segments(radius: float, chord: float = CHORD) -> int:
    """Return the number of chords of a circle, a multiple of 8; radius and chord in meters."""
    return 8 * math.ceil(math.pi / math.acos(1 - chord / radius) / 8)


def arc(radius: float, start: float, stop: float, center: Sequence[float] = (0.0, 0.0)) -> Floats:
    """
    Return points of an arc from ``start`` to ``stop`` (exclusive), (n, 2) meters.

    start, stop : radians; counter-clockwise if stop is greater
    """
    count = max(2, math.ceil(circle_segments(radius) * abs(stop - start) / (2 * math.pi)))
    angles = start + (stop - start) * np.arange(count) / count
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))


def circle(radius: float, center: Sequence[float] = (0.0, 0.0)) -> Floats:
    """Return a counter-clockwise circle, (n, 2) meters; ``[::-1]`` is the outline of a hole."""
    return arc(radius, 0.0, 2 * math.pi, center)


def polyline(*corners: Sequence[float]) -> Floats:
    """Return (n, 2) points of a polyline at most 1 mm apart, without its last corner."""
    pieces = []
    for start, stop in zip(np.array(corners[:-1]), np.array(corners[1:]), strict=True):
        count = math.ceil(np.linalg.norm(stop - start) / _MAX_EDGE)
        pieces.append(start + (stop - start) * (np.arange(count) / count)[:, None])
    return np.concatenate(pieces)


def _walls(layer: Layer) -> Floats:
    """Return (m, 3, 3) corners of the wall triangles of a layer."""
    walls = []
    for bottom, top in zip(layer.bottom, layer.upper, strict=True):
        a = np.column_stack([bottom, np.full(len(bottom), layer.low)])
        d = np.column_stack([top, np.full(len(top), layer.high)])
        b, c = np.roll(a, -1, axis=0), np.roll(d, -1, axis=0)
        walls += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return np.concatenate(walls)


def _caps(below: Outline, above: Outline, height: float) -> list[Floats]:
    """Return the horizontal faces where only one of two adjacent layers has material."""
    corners = (
        np.unique(np.round(np.concatenate([*below, *above]) / _WELD_DISTANCE), axis=0)
        * _WELD_DISTANCE
    )
    extent = 4 * np.abs(corners).max()
    # points far outside keep the outlines off the convex hull, where slivers are omitted
    far = extent * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    points = np.concatenate([corners, far])
    flat = points[Delaunay(points).simplices]
    middles = flat.mean(axis=1)
    under, over = inside(middles, below), inside(middles, above)
    flat[_is_clockwise(flat)] = flat[_is_clockwise(flat)][:, ::-1]
    level = np.dstack([flat, np.full(flat.shape[:2], height)])
    return [level[under & ~over], level[over & ~under][:, ::-1]]


def _is_clockwise(triangles: Floats) -> Bools:
    first, second = (triangles[:, 1:] - triangles[:, :1]).transpose(1, 0, 2)
    return np.asarray(first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0])


def inside(points: Floats, outline: Outline) -> Bools:
    """Return (n,) bool: points (n, 2) inside of ``outline`` (even-odd rule)."""
    odd = np.zeros(len(points), dtype=bool)
    for loop in outline:
        (x0, y0), (x1, y1) = loop.T, np.roll(loop, -1, axis=0).T
        x, y = points.T[..., None]
        between = (y0 > y) != (y1 > y)
        with np.errstate(divide='ignore', invalid='ignore'):
            right = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        odd ^= (between & right).sum(axis=1) % 2 == 1
    return odd


def _weld(triangles: Floats) -> Solid:
    keys = np.round(triangles.reshape(-1, 3) / _WELD_DISTANCE).astype(np.int64)
    unique, index = np.unique(keys, axis=0, return_inverse=True)
    faces: Ints = index.reshape(-1, 3).astype(np.int64)
    vertices: Floats = unique.astype(np.float64) * _WELD_DISTANCE
    return Solid(vertices_xyz=vertices, faces=faces)
