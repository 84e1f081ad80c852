# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Picture of a mesh colored by its signed deviation from a nominal surface."""

from pathlib import Path

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.inspection.reports.rendering import write_sheet
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface

_TILE = (520, 520)
# degrees: azimuth and elevation of the eye
_SIDES = ((35, 35), (215, 35))
_BACKGROUND = 255.0
# BGR at -span, 0, +span: inside of the nominal blue, outside red
_SCALE = np.array([[178.0, 24.0, 33.0], [230.0, 230.0, 230.0], [43.0, 24.0, 178.0]])
_LEGEND_WIDTH, _LEGEND_MARGIN = 150, 60


def write_deviation_image(
    path: Path, surface: Surface, vertices_xyz: Floats, nominal: Surface, span: float
) -> None:
    """
    Draw a mesh from two sides, with a legend in mm.

    surface : the mesh; vertices_xyz : (n, 3) meters, its vertices
    nominal : closed surface in the same frame
    span : meters, deviation at which the colors saturate
    :raises FileError: the file cannot be written
    """
    views = [
        Viewpoint.around(vertices_xyz, np.radians(azimuth), np.radians(elevation), _TILE)
        for azimuth, elevation in _SIDES
    ]
    tiles = [_draw(surface, nominal, span, view) for view in views]
    write_sheet(path, [[*tiles, _legend(span)]])


def deviation_colors(deviations: Floats, span: float) -> Floats:
    """Return (n, 3) BGR of (n,) deviations: blue below, gray at zero, red above."""
    place = np.clip(deviations / span, -1.0, 1.0)
    return np.stack([np.interp(place, (-1.0, 0.0, 1.0), channel) for channel in _SCALE.T], axis=1)


def _draw(surface: Surface, nominal: Surface, span: float, view: Viewpoint) -> ColorImage:
    origins, direction = view.rays()
    hits = surface.cast(origins, direction)
    seen = np.isfinite(hits.distance)
    image = np.full((len(origins), 3), _BACKGROUND)
    points = origins[seen] + hits.distance[seen, None] * direction
    # a deviation must stay readable: shading is weak
    light = 0.55 + 0.45 * np.abs(hits.normals[seen] @ view.towards)
    image[seen] = deviation_colors(nominal.signed_distance(points), span) * light[:, None]
    return image.reshape(view.height, view.width, 3).astype(np.uint8)


def _legend(span: float) -> ColorImage:
    height = _TILE[1]
    image = np.full((height, _LEGEND_WIDTH, 3), _BACKGROUND)
    rows = np.arange(_LEGEND_MARGIN, height - _LEGEND_MARGIN)
    bar = deviation_colors(np.linspace(span, -span, len(rows)), span)
    image[rows, 20:50] = bar[:, None, :]
    drawn = image.astype(np.uint8)
    for share, row in ((1.0, rows[0]), (0.0, height // 2), (-1.0, rows[-1])):
        text = f'{share * span * 1e3:+.2f} mm' if share else '0'
        place, font = (58, int(row) + 5), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(drawn, text, place, font, 0.5, (60, 60, 60), 1, cv2.LINE_AA)
    return drawn
