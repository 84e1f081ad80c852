# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Overview images of a result folder: mesh, point cloud and stripe from several sides."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import draw_cloud
from ivfmc_ros.inspection.reports.rendering import draw_mesh
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.inspection.reports.rendering import write_sheet
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Profile
from ivfmc_ros.surface import Surface

_TILE = (720, 640)
# from the four sides, from above, and from below, where a scan is open
_SIDES = ((20, 20), (110, 20), (200, 20), (290, 20), (20, 80), (20, -30))


def write_mesh_sheet(path: Path, mesh: Mesh) -> None:
    """Draw the mesh from six sides; faces seen from behind are red."""
    surface = Surface(mesh.vertices_xyz, mesh.faces)
    tiles = [draw_mesh(surface, view) for view in _viewpoints(mesh.vertices_xyz)]
    write_sheet(path, [tiles[:3], tiles[3:]])


def write_cloud_sheet(path: Path, points_xyz: Floats, height: Floats) -> None:
    """Draw (n, 3) points from six sides, colored by (n,) values such as their height."""
    tiles = [draw_cloud(points_xyz, height, view) for view in _viewpoints(points_xyz)]
    write_sheet(path, [tiles[:3], tiles[3:]])


def write_stripe_sheet(path: Path, samples: Sequence[tuple[Frame, Profile]]) -> None:
    """Draw the kept stripe points into some of the camera's pictures, four in a row."""
    tiles = [overlay(frame, profile) for frame, profile in samples]
    while len(tiles) % 4:
        tiles.append(np.full_like(tiles[0], 255))
    write_sheet(path, [tiles[k : k + 4] for k in range(0, len(tiles), 4)])


def _viewpoints(points_xyz: Floats) -> list[Viewpoint]:
    return [
        Viewpoint.around(points_xyz, np.radians(azimuth), np.radians(elevation), _TILE)
        for azimuth, elevation in _SIDES
    ]


def overlay(frame: Frame, profile: Profile, width: int = 640) -> ColorImage:
    """Return a camera picture, BGR, ``width`` pixels wide, with the points found in red."""
    image: Any = frame.image if frame.image.dtype == np.uint8 else frame.image // 257
    if image.ndim == 2:
        image = cv2.cvtColor(image.astype(np.uint8), cv2.COLOR_GRAY2BGR)
    scale = width / image.shape[1]
    picture = cv2.resize(image.astype(np.uint8), None, fx=scale, fy=scale)
    pixels = np.round(profile.uv * scale).astype(int)
    inside = (pixels >= 0).all(axis=1) & (pixels < picture.shape[1::-1]).all(axis=1)
    picture[pixels[inside, 1], pixels[inside, 0]] = (0, 0, 255)
    label = f'{frame.seq}: {np.degrees(frame.angle):.2f} deg'
    cv2.putText(picture, label, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1)
    return np.asarray(picture, dtype=np.uint8)
