# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of a cell for the 3-D view, in ``turntable_base``: camera, lasers, volume, platter."""

from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Radius of the platter beyond the working volume, and heights at which it is drawn, meters.
_RIM, _BELOW = 0.01, -0.0005
_CIRCLE = 64
# Distance from the camera at which its field of view is drawn, share of that to the axis.
_FIELD = 0.25


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnShape:
    """
    A triangle mesh: (n, 3) vertices in meters, (m, 3) faces.

    name : of the object that it shows
    """

    name: str
    vertices_xyz: Floats
    faces: Ints


def camera_outline(cell: Cell) -> Floats:
    """Return (8, 2, 3) line segments, meters: the field of view of the camera."""
    camera = cell.camera
    corners = np.array(
        [(0, 0), (camera.width - 1, 0), (camera.width - 1, camera.height - 1),
         (0, camera.height - 1)],
        dtype=float,
    )  # fmt: skip
    distance = float(np.linalg.norm(cell.turntable.camera_from_base[:3, 3]))
    ends = camera.rays(corners) * (_FIELD * distance)
    base_from_camera = transforms.invert(cell.turntable.camera_from_base)
    ends = transforms.apply(base_from_camera, ends)
    center = base_from_camera[:3, 3]
    spokes = np.stack([np.tile(center, (4, 1)), ends], axis=1)
    frame = np.stack([ends, np.roll(ends, -1, axis=0)], axis=1)
    return np.asarray(np.concatenate([spokes, frame]))


def light_sheets(cell: Cell, radius: float, top: float) -> list[DrawnShape]:
    """
    Return one rectangle a laser: its plane, cut by a cylinder about the axis.

    radius, top : meters, of the cylinder
    """
    base_from_camera = transforms.invert(cell.turntable.camera_from_base)
    sheets = []
    for laser in cell.lasers:
        normal = base_from_camera[:3, :3] @ laser.normal
        point = transforms.apply(base_from_camera, -laser.offset * laser.normal[None])[0]
        offset = -float(normal @ point)
        # the horizontal line of the plane at each height is nearest to the axis at its foot
        along = np.array([-normal[1], normal[0], 0.0])
        length = float(np.linalg.norm(along))
        if length < 1e-6:
            # a sheet that lies flat
            continue
        along /= length
        corners = []
        for height in (0.0, top):
            foot = -(offset + normal[2] * height) * normal[:2] / length**2
            half = math.sqrt(max(0.0, radius**2 - float(foot @ foot)))
            ends = (foot + side * half * along[:2] for side in (-1.0, 1.0))
            corners += [(*end, height) for end in ends]
        faces = np.array([(0, 1, 3), (0, 3, 2)])
        sheets.append(DrawnShape(name=laser.name, vertices_xyz=np.array(corners), faces=faces))
    return sheets


def platter(radius: float) -> DrawnShape:
    """Return a disc below the part, larger than a working volume of ``radius`` meters."""
    turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE, endpoint=False)
    edge = (radius + _RIM) * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_CIRCLE)])
    vertices = np.vstack([np.zeros((1, 3)), edge])
    vertices[:, 2] = _BELOW
    index = np.arange(_CIRCLE)
    faces = np.column_stack([np.zeros(_CIRCLE, int), index + 1, (index + 1) % _CIRCLE + 1])
    return DrawnShape(name='platter', vertices_xyz=vertices, faces=faces)


def volume_outline(radius: float, top: float) -> Floats:
    """Return (n, 2, 3) line segments, meters: the edges of the working volume."""
    turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE + 1)
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_CIRCLE + 1)])
    low = np.stack([circle[:-1], circle[1:]], axis=1)
    lift = np.array([0.0, 0.0, top])
    posts = circle[:: _CIRCLE // 4][:4]
    upright = np.stack([posts, posts + lift], axis=1)
    return np.asarray(np.concatenate([low, low + lift, upright]))
