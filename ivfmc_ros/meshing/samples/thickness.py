# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bias of points on curved surfaces that the thickness of the light sheet causes.

Light beside the center of the sheet meets a convex surface deeper, and at a smaller angle, than
light in the center. The profile of the stripe in the image becomes asymmetric, its fitted peak is
biased, and the triangulated point lies inside the surface: by 18 micrometers on a shaft of 12 mm
radius in a sheet of 0.35 mm (1 sigma). The bias is computed in the plane of one stripe line, to
first order in the curvature.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Ratio of the means of u^4 and u^2 across a stripe, in variances of the sheet: how strongly the
# fit of a Gaussian weights the flanks of the stripe. It is 1.5 for equal noise of all pixels and
# 3 at the shot noise limit; speckle raises it. Found on rendered cylinders (test_thickness.py).
_FLANK_WEIGHT = 3.6
_CURVATURE_WINDOW = (15, 7)  # rows and columns over which the curvature is averaged
_SHARP_COSINE = np.cos(np.radians(15.0))  # between neighboring normals: an edge, not a curve
_EDGE_MARGIN = (7, 5)  # rows and columns around an edge in which the curvature is not used
_MIN_NEIGHBORS = 15  # connected neighbors in the window
# Least cosines of the incidence of light and of the viewing direction: at grazing incidence the
# first-order approximation does not hold.
_MIN_COSINE = 0.2
# Standard uncertainty of the bias as a fraction of it: it is of the first order in the curvature.
# Pins and blind holes of 12 and 20 mm were left 0.25 to 0.5 of it too small (simulation with an
# exact cell; sizes that no bench reports).
_RESIDUAL = 0.4
_ZERO = 1e-18  # square meters, between points at one place


@dataclass(frozen=True, eq=False, kw_only=True)
class SheetThickness:
    """
    A light sheet of finite thickness, and the directions at the points of a grid.

    to_camera : unit vectors to the camera, broadcast to (rows, columns, 3)
    error_direction : unit vectors in the sheet and in the plane of the stripe line, likewise
    thickness : meters, 1 sigma of the sheet
    """

    to_camera: Floats
    error_direction: Floats
    thickness: float


def thickness_bias(
    points: Floats, normals: Floats, connected: Bools, sheet: SheetThickness
) -> tuple[Floats, Floats]:
    """
    Return by how much points lie inside the surface, along their normals, and its uncertainty.

    points, normals : (rows, columns, 3), meters and unit; NaN where there is no point
    connected : (rows, columns) bool, the point in the next column is on the same surface
    returns : (rows, columns) meters; 0 where the curvature is unknown; and its standard
        uncertainty, there the bias of the curvature between neighboring columns
    """
    normals = np.nan_to_num(normals)
    curvature, local = _curvature(points, normals, connected)
    per_curvature = _bias_per_curvature(normals, sheet)
    bias = curvature * per_curvature
    return bias, np.abs(np.where(np.isfinite(local), local * per_curvature, _RESIDUAL * bias))


def _curvature(points: Floats, normals: Floats, connected: Bools) -> tuple[Floats, Floats]:
    """
    Return the mean curvature across columns, 1/meter, convex positive; 0 where unknown.

    returns : (rows, columns); and the greatest to the next columns where the mean is unknown, NaN
        where it is known
    """
    after = np.roll(normals, -1, axis=1)
    step = np.where(connected[..., None], np.roll(points, -1, axis=1) - points, 0.0)
    sharp = connected & ((normals * after).sum(axis=2) < _SHARP_COSINE)
    good = connected & ~ndimage.maximum_filter(sharp, _EDGE_MARGIN, mode='wrap')
    turn = np.where(good, ((after - normals) * step).sum(axis=2), 0.0)
    length = np.where(good, (step * step).sum(axis=2), 0.0)
    mean = [
        ndimage.uniform_filter(values, _CURVATURE_WINDOW, mode=('constant', 'wrap'))
        for values in (turn, length, good.astype(np.float64))
    ]
    size = _CURVATURE_WINDOW[0] * _CURVATURE_WINDOW[1]
    enough = mean[2] * size >= _MIN_NEIGHBORS - 0.5
    known = np.where(enough, mean[0] / np.maximum(mean[1], 1e-30), 0.0)
    raw = np.abs(((after - normals) * step).sum(axis=2)) / np.maximum(
        (step * step).sum(axis=2), _ZERO
    )
    local = np.where(connected, raw, 0.0)
    return known, np.where(enough, np.nan, np.maximum(local, np.roll(local, 1, axis=1)))


def _bias_per_curvature(normals: Floats, sheet: SheetThickness) -> Floats:
    """Return (rows, columns) meters inward for a curvature of 1/meter."""
    to_camera = sheet.to_camera
    n_light = _dot(normals, sheet.error_direction)
    ray = sheet.error_direction * np.copysign(1.0, n_light)[..., None]
    n_light = np.abs(n_light)
    # axes in the plane of the stripe line: along the surface, in the image, across the sheet
    line = _unit(np.cross(to_camera, ray))
    along = _unit(np.cross(normals, line))
    image = _unit(ray - _dot(ray, to_camera)[..., None] * to_camera)
    across = np.cross(line, ray)
    # to second order in t along the surface, of curvature k: u = a t - k b t^2 in the image,
    # s = c t - k d t^2 across the sheet, and the irradiance ln L = k e t
    a, b = _dot(along, image), 0.5 * _dot(normals, image)
    c, d = _dot(along, across), 0.5 * _dot(normals, across)
    valid = (n_light > _MIN_COSINE) & (np.abs(a) > _MIN_COSINE) & (np.abs(c) > 1e-3)
    with np.errstate(invalid='ignore', divide='ignore'):
        e = _dot(along, ray) / n_light
        variance = (sheet.thickness * a / c) ** 2
        shift = variance * (e / a + _FLANK_WEIGHT * (d / (a * c) - b / a**2))
        bias = -shift * n_light / _dot(ray, image)
    return np.asarray(np.where(valid, bias, 0.0))


def _dot(first: Floats, second: Floats) -> Floats:
    return np.asarray((first * second).sum(axis=-1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
