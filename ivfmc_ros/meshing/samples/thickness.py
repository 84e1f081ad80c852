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
from scipy.stats import norm

from ivfmc_ros.meshing.samples.row_curvature import RowCurvature
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Ratio of the means of u^4 and u^2 across a stripe, in variances of the sheet: how strongly the
# fit of a Gaussian weights the flanks of the stripe. It is 1.5 for equal noise of all pixels and
# 3 at the shot noise limit; speckle raises it. A regression over rendered pins and holes of 12 to
# 24 mm gave 3.11, and 1.02 for the factor of the irradiance; over spheres of 22 mm 3.27.
_FLANK_WEIGHT = 3.1
# Least cosines of the incidence of light and of the viewing direction: at grazing incidence the
# first-order approximation does not hold.
_MIN_COSINE = 0.2
# Standard uncertainty of the bias as a fraction of it: it is of the first order in the curvature,
# which is estimated. Of the bias of pins and holes of 12, 20 and 24 mm up to a fifth was left, at
# most angles less (simulation with an exact cell; sizes that no bench reports).
_RESIDUAL = 0.25


# Points whose sheet reaches the terminator of the light are off by as much as the center of a
# Gaussian that is cut there, with these factors of its distance and of the shift. Found on a
# rendered sphere of 22 mm, where points at 0.75, 1.6 and 2.7 sigmas were off by 1, 0.45 and 0.1.
_TERMINATOR_REACH, _TERMINATOR_SHIFT = 1.5, 1.6
_TERMINATOR_WINDOW = (15, 21)  # rows and columns


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
    curvature: RowCurvature, normals: Floats, sheet: SheetThickness
) -> tuple[Floats, Floats]:
    """
    Return by how much points lie inside the surface, along their normals, and its uncertainty.

    normals : (rows, columns, 3) unit, NaN where unknown
    returns : (rows, columns) meters, 0 where the curvature is unknown; and its standard
        uncertainty: there, and at grazing incidence, the bias of the local curvature
    """
    found = _first_order(np.nan_to_num(normals), sheet)
    corrected = curvature.known & found.valid
    bias = np.where(corrected, curvature.value * found.bias, 0.0)
    higher = curvature.value**2 * found.change * found.parts
    u = np.where(
        corrected, np.hypot(_RESIDUAL * bias, higher), curvature.local * np.abs(found.bias)
    )
    beyond = _past_terminator(curvature, found.to_terminator, sheet.thickness)
    return bias, np.minimum(np.hypot(u, beyond), sheet.thickness)


def _past_terminator(curvature: RowCurvature, per_curvature: Floats, thickness: float) -> Floats:
    """
    Return 1 sigma, meters, of points whose sheet reaches to where its light grazes the surface.

    The curvature is the greatest around: where points are off, they show none themselves.
    """
    greatest = ndimage.maximum_filter(
        np.maximum(curvature.value, 0.0), _TERMINATOR_WINDOW, mode=('nearest', 'wrap')
    )
    margin = per_curvature / np.maximum(greatest * thickness, 1e-12) / _TERMINATOR_REACH
    shift = norm.pdf(margin) / norm.cdf(margin) * thickness
    return np.asarray(np.where(greatest > 0.0, _TERMINATOR_SHIFT * shift, 0.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class _FirstOrder:
    """
    Effects of a curvature of 1/meter, (rows, columns).

    bias : meters inward: the difference of two effects, of irradiance and of position
    parts : meters, sum of their magnitudes
    change : relative change of the irradiance over 1 sigma of the sheet
    to_terminator : without a unit: distance from the middle of the sheet, times the curvature, of
        the place where the light grazes a convex surface
    valid : bool, whether light and camera do not graze the surface
    """

    bias: Floats
    parts: Floats
    change: Floats
    to_terminator: Floats
    valid: Bools


def _first_order(normals: Floats, sheet: SheetThickness) -> _FirstOrder:
    to_camera = sheet.to_camera
    n_light = _dot(normals, sheet.error_direction)
    ray = sheet.error_direction * np.copysign(1.0, n_light)[..., None]
    n_light = np.abs(n_light)
    # axes in the plane of the stripe line: along the surface, in the image, across the sheet
    line = _unit(np.cross(to_camera, ray))
    along = _unit(np.cross(normals, line))
    image = _unit(ray - _dot(ray, to_camera)[..., None] * to_camera)
    across = np.cross(line, ray)
    # the plane cuts the surface obliquely, in a curve of greater curvature (Meusnier)
    oblique = np.maximum(1.0 - _dot(normals, line) ** 2, _MIN_COSINE**2)
    # to second order in t along the surface, of curvature k: u = a t - k b t^2 in the image,
    # s = c t - k d t^2 across the sheet, and the irradiance ln L = k e t
    a, b = _dot(along, image), 0.5 * _dot(normals, image) / oblique
    c, d = _dot(along, across), 0.5 * _dot(normals, across) / oblique
    valid = (n_light > _MIN_COSINE) & (np.abs(a) > _MIN_COSINE) & (np.abs(c) > 1e-3)
    with np.errstate(invalid='ignore', divide='ignore'):
        e = _dot(along, ray) / n_light
        scale = -((sheet.thickness * a / c) ** 2) * n_light / _dot(ray, image)
        brighter, bent = scale * e / a, scale * _FLANK_WEIGHT * (d / (a * c) - b / a**2)
        change = sheet.thickness * np.abs(e / c)
    finite = np.isfinite(brighter) & np.isfinite(bent)
    return _FirstOrder(
        bias=np.where(finite, brighter + bent, 0.0),
        parts=np.where(finite, np.abs(brighter) + np.abs(bent), 0.0),
        change=np.where(finite, change, 0.0),
        to_terminator=np.sqrt(oblique) - np.sqrt(np.maximum(oblique - n_light**2, 0.0)),
        valid=np.asarray(valid & finite),
    )


def _dot(first: Floats, second: Floats) -> Floats:
    return np.asarray((first * second).sum(axis=-1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
