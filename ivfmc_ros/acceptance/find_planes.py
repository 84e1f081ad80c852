# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planes in a scanned surface: the largest one, and two parallel ones of a step (RANSAC)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection.features import fit
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_TRIALS = 300  # random vertices whose tangent planes are tried
# Meters: points of a plate are within this distance of its plane. A plate is ground within 0.01.
_BAND = 2e-3
_MIN_COSINE = 0.9  # between the normals of plane and point
_EDGE = 2e-3  # meters, from points that are not on the plane: edges are rounded by the mesh
_MIN_POINTS = 200
_MIN_SPREAD = 5e-3  # meters, 1 sigma along the shorter side: a strip determines no plane
# A plate is bent if a quadratic surface explains this share of the variance of its deviations,
# and the bend is larger than this range in meters.
_BEND_SHARE = 0.7
_MIN_BEND = 1e-4
# Heights of a step are searched up to this share beside the nominal.
_STEP_SEARCH = 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundPlane:
    """
    A plane in a scan.

    rows : (n,) indices of its points
    center_xyz, normal : (3,) meters and unit, of the least-squares plane
    """

    rows: Ints
    center_xyz: Floats
    normal: Floats

    def heights(self, points_xyz: Floats) -> Floats:
        """Return (n,) meters: signed distances from the plane."""
        return np.asarray((points_xyz - self.center_xyz) @ self.normal)


def find_plate(points_xyz: Floats, normals: Floats) -> FoundPlane:
    """
    Find the plane with most points.

    :raises GeometryError: there is none, or it is bent
    """
    plane = largest_plane(points_xyz, normals, np.arange(len(points_xyz)))
    _require_flat(plane, points_xyz[plane.rows])
    return plane


def find_step(points_xyz: Floats, normals: Floats, height: float) -> tuple[FoundPlane, FoundPlane]:
    """
    Find two parallel planes that are ``height`` meters apart, within 30 %.

    :raises GeometryError: there are none
    """
    first = largest_plane(points_xyz, normals, np.arange(len(points_xyz)))
    off = np.abs(first.heights(points_xyz))
    beside = np.flatnonzero(np.abs(off - height) < _STEP_SEARCH * height)
    try:
        second = largest_plane(points_xyz, normals, beside, like=first.normal)
    except GeometryError:
        raise GeometryError(
            f'gauge_step: no plane {height * 1e3:.4g} mm beside the largest one; is the height in '
            'the right unit, and are both faces in the working volume?'
        ) from None
    return first, second


def largest_plane(
    points_xyz: Floats, normals: Floats, chosen: Ints, like: Floats | None = None
) -> FoundPlane:
    """
    Find the plane with most of the chosen points.

    like : (3,) its normal, within 25 degrees, either side; None: any
    :raises GeometryError: there is none
    """
    rng = np.random.default_rng(0)
    points, own = points_xyz[chosen], normals[chosen]
    if like is not None:
        keep = np.abs(own @ like) > _MIN_COSINE
        chosen, points, own = chosen[keep], points[keep], own[keep]
    if len(points) < _MIN_POINTS:
        raise GeometryError('plate: no plane found: too few points; is it in the working volume?')
    best, most = np.zeros(len(points), dtype=bool), 0
    sample = rng.choice(len(points), min(_TRIALS, len(points)), replace=False)
    few = rng.choice(len(points), min(5000, len(points)), replace=False)
    for index in sample:
        count = int(_on_plane(points[few], own[few], points[index], own[index]).sum())
        if count > most:
            best, most = _on_plane(points, own, points[index], own[index]), count
    for _ in range(3):
        feature = fit('plane', points[best])
        best = _on_plane(points, own, feature.center_xyz, feature.axis, both=True)
    rows = _away_from_others(points_xyz, chosen[best])
    _require_extent(points_xyz[rows])
    feature = fit('plane', points_xyz[rows])
    return FoundPlane(rows=rows, center_xyz=feature.center_xyz, normal=feature.axis)


def _on_plane(
    points: Floats, normals: Floats, center: Floats, normal: Floats, *, both: bool = False
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    facing = normals @ normal
    facing = np.abs(facing) if both else facing
    return np.asarray((np.abs((points - center) @ normal) < _BAND) & (facing > _MIN_COSINE))


def _away_from_others(points: Floats, rows: Ints) -> Ints:
    others = np.ones(len(points), dtype=bool)
    others[rows] = False
    if not others.any() or not len(rows):
        return rows
    distance, _ = cKDTree(points[others]).query(points[rows])
    return np.asarray(rows[distance > _EDGE])


def _require_extent(points: Floats) -> None:
    if len(points) >= _MIN_POINTS:
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] / np.sqrt(len(points)) >= _MIN_SPREAD:
            return
    raise GeometryError(
        f'plate: the largest plane has {len(points)} points on a strip narrower than '
        f'{4e3 * _MIN_SPREAD:.0f} mm; use a larger plate'
    )


def _require_flat(plane: FoundPlane, points: Floats) -> None:
    """:raises GeometryError: most of the deviations are a bend, of the plate or of the cell."""
    axes = np.linalg.svd(points - plane.center_xyz, full_matrices=False)[2][:2]
    x, y = ((points - plane.center_xyz) @ axes.T).T
    heights = plane.heights(points)
    linear = np.column_stack([np.ones_like(x), x, y])
    design = np.column_stack([x * x, x * y, y * y])
    design = design - linear @ np.linalg.lstsq(linear, design, rcond=None)[0]
    bend = design @ np.linalg.lstsq(design, heights, rcond=None)[0]
    share = float(bend.var() / max(heights.var(), 1e-30))
    if share > _BEND_SHARE and np.ptp(bend) > _MIN_BEND:
        raise GeometryError(
            f'plate: it is not flat: {share:.0%} of its deviations are one bend of '
            f'{np.ptp(bend) * 1e3:.2f} mm; use a flat plate. If this one is flat, the cell bends '
            'it: calibrate again'
        )
