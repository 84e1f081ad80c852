# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Software rendering of point clouds and meshes to images, without a window or GPU."""

from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros import files
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

ColorImage = NDArray[np.uint8]
Color = tuple[int, int, int]

INK_BGR: Color = (48, 37, 28)
_WHITE: Color = (255, 255, 255)
_BLACK: Color = (0, 0, 0)

_PAPER = 250.0
FRONT_BGR: Color = (225, 214, 200)
_FRONT = np.array(FRONT_BGR, dtype=np.float64)
# a mesh that is inside out must not look right
BACK_BGR: Color = (60, 60, 230)
_BACK = np.array(BACK_BGR, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """
    A parallel projection that shows a box of points from one side.

    center : (3,) meters, at the middle of the picture
    right, up, towards : (3,) unit vectors, towards the eye
    scale : pixels per meter
    """

    center: Floats
    right: Floats
    up: Floats
    towards: Floats
    scale: float
    width: int
    height: int

    @classmethod
    def around(
        cls, points_xyz: Floats, azimuth: float, elevation: float, size: tuple[int, int]
    ) -> 'Viewpoint':
        """
        Fit (n, 3) points into a picture of ``size`` (width, height).

        azimuth, elevation : radians, where the eye is; z is up
        """
        ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
        right = np.array([-sa, ca, 0.0])
        up = np.array([-ca * se, -sa * se, ce])
        towards = np.array([ca * ce, sa * ce, se])
        low, high = points_xyz.min(axis=0), points_xyz.max(axis=0)
        center = 0.5 * (low + high)
        seen = (points_xyz - center) @ np.stack([right, up], axis=1)
        extent = np.maximum(np.abs(seen).max(axis=0), 1e-9)
        scale = 0.46 * min(size[0] / extent[0], size[1] / extent[1])
        return cls(center, right, up, towards, scale, *size)

    def pixels(self, points_xyz: Floats) -> tuple[Ints, Ints, Floats]:
        """Return column, row and height towards the eye (meters) of (n, 3) points."""
        offset = points_xyz - self.center
        column = np.round(offset @ self.right * self.scale + self.width / 2)
        row = np.round(self.height / 2 - offset @ self.up * self.scale)
        return column.astype(np.int64), row.astype(np.int64), offset @ self.towards

    def rays(self) -> tuple[Floats, Floats]:
        """Return (height * width, 3) origins in front of everything, and the (3,) direction."""
        columns, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        right = ((columns - self.width / 2) / self.scale).reshape(-1, 1)
        up = ((self.height / 2 - rows) / self.scale).reshape(-1, 1)
        far = 2.0 * (self.width + self.height) / self.scale
        return self.center + right * self.right + up * self.up + far * self.towards, -self.towards


def draw_mesh(surface: Surface, viewpoint: Viewpoint) -> ColorImage:
    """Return a shaded (height, width, 3) BGR picture; faces seen from behind are red."""
    origins, direction = viewpoint.rays()
    hits = surface.cast(origins, direction)
    facing = hits.normals @ viewpoint.towards
    light = 0.25 + 0.75 * np.abs(facing)[:, None]
    color = np.where(facing[:, None] >= 0.0, _FRONT, _BACK) * light
    color = np.where(np.isfinite(hits.distance)[:, None], color, _PAPER)
    return color.reshape(viewpoint.height, viewpoint.width, 3).astype(np.uint8)


def draw_cloud(points_xyz: Floats, values: Floats, viewpoint: Viewpoint) -> ColorImage:
    """
    Return a (height, width, 3) BGR picture of points, nearer ones in front.

    values : (n,) what the color shows; spread over its 2 % to 98 % range
    """
    if not len(points_xyz):
        return draw_points(points_xyz, np.empty((0, 3), dtype=np.uint8), viewpoint)
    low, high = np.percentile(values, [2, 98])
    gray = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0) * 255.0
    colors = cv2.applyColorMap(gray.astype(np.uint8).reshape(-1, 1), cv2.COLORMAP_VIRIDIS)
    return draw_points(points_xyz, colors[:, 0], viewpoint)


def draw_points(points_xyz: Floats, colors: ColorImage, viewpoint: Viewpoint) -> ColorImage:
    """Return a (height, width, 3) BGR picture of points in (n, 3) BGR, nearer ones in front."""
    picture: Any = np.full((viewpoint.height, viewpoint.width, 3), int(_PAPER), dtype=np.uint8)
    column, row, height = viewpoint.pixels(points_xyz)
    order = np.argsort(height)
    inside = (column >= 0) & (column < viewpoint.width - 1)
    inside &= (row >= 0) & (row < viewpoint.height - 1)
    order = order[inside[order]]
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        picture[row[order] + down, column[order] + right] = colors[order]
    return np.asarray(picture, dtype=np.uint8)


def write_text(picture: Any, text: str, place: tuple[int, int], bgr: Color = _WHITE) -> None:
    """Write a text into a picture with its lower left corner at ``place``, on any background."""
    edge = _BLACK if sum(bgr) > 380 else _WHITE
    for color, thickness in ((edge, 3), (bgr, 1)):
        cv2.putText(
            picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, thickness, cv2.LINE_AA
        )


def scale_bar(pixels_per_meter: float, width: int) -> tuple[float, float]:
    """Return (meters, pixels) of a bar of 1, 2 or 5 times a power of ten, at most a quarter."""
    longest = 0.25 * width / pixels_per_meter
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * 1.0001)
    return length, length * pixels_per_meter


def draw_scale_bar(picture: Any, viewpoint: Viewpoint) -> None:
    """Draw a bar with its length into the lower left corner of a picture of a viewpoint."""
    length, pixels = scale_bar(viewpoint.scale, viewpoint.width)
    left, row = 16, viewpoint.height - 16
    right = left + round(pixels)
    cv2.rectangle(picture, (left, row - 5), (right, row), INK_BGR, cv2.FILLED)
    write_text(picture, f'{length * 1e3:g} mm', (left, row - 12), INK_BGR)


def write_sheet(path: Path, tiles: list[list[ColorImage]]) -> None:
    """
    Write rows of equally large pictures as one PNG.

    :raises FileError: it cannot be written
    """
    sheet = np.concatenate([np.concatenate(row, axis=1) for row in tiles], axis=0)
    # imwrite says False where a disk is full, and leaves an empty file
    _, encoded = cv2.imencode('.png', sheet)
    with files.atomic_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
