# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds before and after registration, colored by their distance from the mesh."""

from collections.abc import Sequence

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import draw_points
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.surface import Surface

_TILE = (1000, 800)
# Points of a cloud that are drawn.
_MAX_POINTS = 400_000
# Radians: the picture is seen from here.
_AZIMUTH, _ELEVATION = np.radians(20.0), np.radians(25.0)
# Percentile of the absolute distances at which the colors end.
_SPAN_PERCENTILE = 95.0
# Meters: what registration moved by less is not to be seen.
_MIN_MOTION = 1e-7


def registration_maps(
    mesh: Mesh, views: Sequence[View], poses: Poses
) -> list[tuple[ColorImage, str, ColorBar | None]]:
    """
    Return pictures with captions: before and after registration in the same colors.

    Where registration moved nothing, one picture with a color for each view.
    """
    before = [view.cloud() for view in views]
    if not sum(map(len, before)):
        return []
    after = [
        transforms.apply(T, cloud)
        for cloud, T in zip(before, poses.turntable_from_view, strict=True)
    ]
    step = 1 + sum(map(len, before)) // _MAX_POINTS
    first, second = (np.concatenate(clouds)[::step] for clouds in (before, after))
    viewpoint = Viewpoint.around(first, _AZIMUTH, _ELEVATION, _TILE)
    motion = np.linalg.norm(second - first, axis=1)
    if float(motion.max()) < _MIN_MOTION or not len(mesh.faces):
        number = np.repeat(np.arange(len(views)), [len(cloud) for cloud in before])[::step]
        scale = ColorBar(low=0.0, high=float(max(len(views) - 1, 1)), quantity='view')
        colors = scale.colors(number.astype(np.float64))
        caption = 'points, a color for each view; the poses of the table were kept'
        return [(draw_points(first, colors, viewpoint), caption, None)]
    surface = Surface(mesh.vertices_xyz, mesh.faces)
    offsets = [_offsets(surface, points) for points in (first, second)]
    span = float(np.percentile(np.abs(offsets[0]), _SPAN_PERCENTILE))
    bar = ColorBar(low=-span, high=span, quantity='distance from the mesh')
    largest = float(motion.max()) * 1e3
    return [
        (
            draw_points(points, bar.colors(values), viewpoint),
            f'{when} registration{more}; 95 % of the points within '
            f'{np.percentile(np.abs(values), _SPAN_PERCENTILE) * 1e3:.4f} mm',
            bar,
        )
        for when, more, points, values in (
            ('before', '', first, offsets[0]),
            ('after', f', which moved points by up to {largest:.4f} mm', second, offsets[1]),
        )
    ]


def _offsets(surface: Surface, points_xyz: Floats) -> Floats:
    """Return (n,) meters from the mesh, positive outside."""
    near = surface.nearest(points_xyz)
    side = np.sign(((points_xyz - near.points_xyz) * near.normals).sum(axis=1))
    return np.asarray(near.distance * side)
