# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the thickness of the light does on a curved surface, taken off the points.

Light beside the middle of the sheet meets a convex surface deeper, and less squarely, than light
in the middle. The picture of the stripe is no longer even, its fitted middle is off, and the
point that is triangulated from it lies inside of the surface: by 18 micrometres on a shaft of
12 mm radius in a sheet of 0.35 mm. All of this is in the plane of one stripe line, and of first
order in the curvature there.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# The mean of u^4 over that of u^2 across a stripe, in variances of the sheet: how much a fit of a
# Gaussian feels the stripe's flanks. 1.5 if all grey values were equally good, 3 at the limit of
# shot noise; speckle makes the flanks count more (found on rendered cylinders).
_FLANKS = 3.6
_WINDOW = (15, 7)  # rows and columns over which the curvature is averaged
_SHARP = np.cos(np.radians(15.0))  # between neighbours: an edge, not a curve
_EDGE = (7, 5)  # rows and columns around an edge in which there is no curvature to be had
_LEAST_PAIRS = 15
# Surfaces along the light or the sight have no such small effect.
_LEAST_COSINE = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Light:
    """
    How points of a grid were lit and seen.

    sight : unit vectors to the eye, broadcast to (rows, columns, 3)
    error : unit vectors in the sheet and in the plane of the stripe line, likewise
    thickness : metres, 1 sigma of the sheet
    """

    sight: Floats
    error: Floats
    thickness: float


def inward(points: Floats, normals: Floats, linked: Bools, light: Light) -> Floats:
    """
    Return (rows, columns) by how much points lie inside of the surface along normals, metres.

    points, normals : (rows, columns, 3); NaN where nothing is
    linked : (rows, columns), the point in the next column is on the same surface
    """
    normals = np.nan_to_num(normals)
    return _curvature(points, normals, linked) * _effect(normals, light)


def _curvature(points: Floats, normals: Floats, linked: Bools) -> Floats:
    """Return the curvature from column to column, 1/metre, convex positive; 0 if not known."""
    after = np.roll(normals, -1, axis=1)
    step = np.where(linked[..., None], np.roll(points, -1, axis=1) - points, 0.0)
    sharp = linked & ((normals * after).sum(axis=2) < _SHARP)
    good = linked & ~ndimage.maximum_filter(sharp, _EDGE, mode='wrap')
    turn = np.where(good, ((after - normals) * step).sum(axis=2), 0.0)
    length = np.where(good, (step * step).sum(axis=2), 0.0)
    mean = [
        ndimage.uniform_filter(values, _WINDOW, mode=('constant', 'wrap'))
        for values in (turn, length, good.astype(np.float64))
    ]
    enough = mean[2] * (_WINDOW[0] * _WINDOW[1]) >= _LEAST_PAIRS - 0.5
    return np.asarray(np.where(enough, mean[0] / np.maximum(mean[1], 1e-30), 0.0))


def _effect(normals: Floats, light: Light) -> Floats:
    """Return (rows, columns) metres inward for a curvature of 1/metre."""
    sight = light.sight
    n_light = _dot(normals, light.error)
    ray = light.error * np.copysign(1.0, n_light)[..., None]
    n_light = np.abs(n_light)
    # axes in the plane of the stripe line: along the surface, in the picture, across the sheet
    line = _unit(np.cross(sight, ray))
    along = _unit(np.cross(normals, line))
    picture = _unit(ray - _dot(ray, sight)[..., None] * sight)
    across = np.cross(line, ray)
    # to second order in t along the surface, of curvature k: u = a t - k b t^2 in the picture,
    # s = c t - k d t^2 across the sheet, and the light ln L = k e t
    a, b = _dot(along, picture), 0.5 * _dot(normals, picture)
    c, d = _dot(along, across), 0.5 * _dot(normals, across)
    seen = (n_light > _LEAST_COSINE) & (np.abs(a) > _LEAST_COSINE) & (np.abs(c) > 1e-3)
    with np.errstate(invalid='ignore', divide='ignore'):
        e = _dot(along, ray) / n_light
        variance = (light.thickness * a / c) ** 2
        shift = variance * (e / a + _FLANKS * (d / (a * c) - b / a**2))
        effect = -shift * n_light / _dot(ray, picture)
    return np.asarray(np.where(seen, effect, 0.0))


def _dot(first: Floats, second: Floats) -> Floats:
    return np.asarray((first * second).sum(axis=-1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
