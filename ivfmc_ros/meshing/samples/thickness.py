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
    per_curvature, valid = _bias_per_curvature(np.nan_to_num(normals), sheet)
    corrected = curvature.known & valid
    bias = np.where(corrected, curvature.value * per_curvature, 0.0)
    unknown = np.minimum(curvature.local * np.abs(per_curvature), sheet.thickness)
    return bias, np.where(corrected, _RESIDUAL * np.abs(bias), unknown)


def _bias_per_curvature(normals: Floats, sheet: SheetThickness) -> tuple[Floats, Bools]:
    """Return (rows, columns) meters inward for a curvature of 1/meter, and where that holds."""
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
        variance = (sheet.thickness * a / c) ** 2
        shift = variance * (e / a + _FLANK_WEIGHT * (d / (a * c) - b / a**2))
        bias = -shift * n_light / _dot(ray, image)
    return np.asarray(np.where(np.isfinite(bias), bias, 0.0)), np.asarray(valid)


def _dot(first: Floats, second: Floats) -> Floats:
    return np.asarray((first * second).sum(axis=-1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
