# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Overview images of a result folder: mesh, point cloud and stripe from several sides."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.rendering import BACK_BGR
from ivfmc_ros.inspection.reports.rendering import Color
from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import draw_cloud
from ivfmc_ros.inspection.reports.rendering import draw_mesh
from ivfmc_ros.inspection.reports.rendering import draw_scale_bar
from ivfmc_ros.inspection.reports.rendering import FRONT_BGR
from ivfmc_ros.inspection.reports.rendering import INK_BGR
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.inspection.reports.rendering import write_sheet
from ivfmc_ros.inspection.reports.rendering import write_text
from ivfmc_ros.inspection.reports.stripe_pictures import overlay
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Profile
from ivfmc_ros.surface import Surface

_TILE = (720, 640)
# from the four sides, from above, and from below, where a scan is open
_SIDES = ((20, 20), (110, 20), (200, 20), (290, 20), (20, 80), (20, -30))
_LEGEND_HEIGHT = 44
_PAPER = 250
# Tiles of stripes in a row, the best first; what does not fill a row is left out.
_COLUMNS = (4, 3, 5, 2, 1)


def write_mesh_sheet(path: Path, mesh: Mesh) -> None:
    """Draw the mesh from six sides; faces seen from behind are red."""
    surface = Surface(mesh.vertices_xyz, mesh.faces)
    tiles = [
        _annotated(draw_mesh(surface, view), view, side)
        for view, side in _viewpoints(mesh.vertices_xyz)
    ]
    swatches = (
        (FRONT_BGR, 'front of a face'),
        (BACK_BGR, 'back of a face: the inside of the surface, seen through an opening'),
    )
    write_sheet(path, [tiles[:3], tiles[3:], [_legend(swatches)]])


def write_cloud_sheet(path: Path, points_xyz: Floats, height: Floats) -> None:
    """Draw (n, 3) points from six sides, colored by (n,) heights in meters."""
    tiles = [
        _annotated(draw_cloud(points_xyz, height, view), view, side)
        for view, side in _viewpoints(points_xyz)
    ]
    # the colors span what draw_cloud spreads them over
    low, high = np.percentile(height, [2, 98]) * 1e3 if len(height) else (0.0, 0.0)
    ramp: Any = cv2.applyColorMap(
        np.array([[0], [128], [255]], dtype=np.uint8), cv2.COLORMAP_VIRIDIS
    )
    texts = (f'height {low:.1f} mm', f'{0.5 * (low + high):.1f} mm', f'{high:.1f} mm')
    colors = [(int(b), int(g), int(r)) for b, g, r in ramp[:, 0]]
    write_sheet(path, [tiles[:3], tiles[3:], [_legend(tuple(zip(colors, texts, strict=True)))]])


def write_stripe_sheet(path: Path, samples: Sequence[tuple[Frame, Profile]]) -> None:
    """Draw the kept stripe points into some of the camera's pictures, in full rows."""
    columns = max(_COLUMNS, key=lambda count: count * (len(samples) // count))
    shown = samples[: columns * (len(samples) // columns)]
    tiles = [overlay(frame, profile) for frame, profile in shown]
    write_sheet(path, [tiles[k : k + columns] for k in range(0, len(tiles), columns)])


def _viewpoints(points_xyz: Floats) -> list[tuple[Viewpoint, tuple[int, int]]]:
    return [
        (Viewpoint.around(points_xyz, np.radians(side[0]), np.radians(side[1]), _TILE), side)
        for side in _SIDES
    ]


def _annotated(tile: ColorImage, viewpoint: Viewpoint, side: tuple[int, int]) -> ColorImage:
    draw_scale_bar(tile, viewpoint)
    label = f'from azimuth {side[0]} deg, elevation {side[1]} deg'
    write_text(tile, label, (16, 24), INK_BGR)
    return tile


def _legend(swatches: Sequence[tuple[Color, str]]) -> ColorImage:
    """Return a strip as wide as a row of tiles with colors and what they mean."""
    strip: Any = np.full((_LEGEND_HEIGHT, 3 * _TILE[0], 3), _PAPER, dtype=np.uint8)
    left = 16
    for color, text in swatches:
        cv2.rectangle(strip, (left, 12), (left + 28, 32), color, cv2.FILLED)
        cv2.rectangle(strip, (left, 12), (left + 28, 32), INK_BGR, 1)
        write_text(strip, text, (left + 38, 27), INK_BGR)
        left += 80 + 10 * len(text)
    return np.asarray(strip, dtype=np.uint8)
