# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact stripes on the spheres of a ball bar, put into space by a cell that errs."""

from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats

# Bar of 100 mm across the axis, 30 mm above the platter; spheres of 20 mm.
CENTERS = np.array([[-0.05, 0.0, 0.03], [0.05, 0.0, 0.03]])
RADIUS, LENGTH = 0.010, 0.1
NOISE_PX = 0.015  # of a point of the merged mesh, which averages noise: 0.003 mm in space


def ball_bar_points(
    true: Cell, found: Cell, lasers: tuple[int, ...] = (0, 1), steps: int = 240, seed: int = 0
) -> tuple[Floats, Floats]:
    """
    Return points and outward normals, (n, 3), in ``turntable`` as the cell ``found`` sees them.

    true : the cell that took the pictures
    """
    rng, points, normals = np.random.default_rng(seed), [], []
    for center in CENTERS:
        parts = [
            _arc(true, found, center, laser, angle, rng)
            for laser in lasers
            for angle in 2 * np.pi * np.arange(steps) / steps
        ]
        own = np.concatenate([part for part in parts if len(part)])
        arms = own - center
        points.append(own)
        normals.append(arms / np.linalg.norm(arms, axis=1, keepdims=True))
    return np.concatenate(points), np.concatenate(normals)


def _arc(
    true: Cell, found: Cell, center: Floats, laser: int, angle: float, rng: np.random.Generator
) -> Floats:
    plane, middle = true.lasers[laser], true.turntable.to_camera(center[None], angle)[0]
    off = float(plane.distance(middle[None])[0])
    if abs(off) > 0.9 * RADIUS:
        return np.empty((0, 3))
    foot, radius = middle - off * plane.normal, np.sqrt(RADIUS**2 - off**2)
    first = np.cross(plane.normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    second = np.cross(plane.normal, first)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None]
    circle = foot + radius * (np.cos(turn) * first + np.sin(turn) * second)
    # what faces the camera by 72 degrees or less
    outward = (circle - middle) / RADIUS
    sight = -circle / np.linalg.norm(circle, axis=1, keepdims=True)
    circle = circle[(outward * sight).sum(axis=1) > 0.3]
    if not len(circle):
        return circle
    uv = true.camera.project(circle)
    uv[:, 0] += NOISE_PX * rng.standard_normal(len(uv))
    seen = found.lasers[laser].intersect(found.camera.rays(uv))
    return found.turntable.to_part(seen, angle)


def with_turned_laser(cell: Cell, index: int, degrees: float, about: str = 'upright') -> Cell:
    """Return the cell with a laser plane turned about a line of its own through the axis."""
    laser, T = cell.lasers[index], cell.turntable.camera_from_base
    upright = T[:3, 2] - (T[:3, 2] @ laser.normal) * laser.normal
    upright /= np.linalg.norm(upright)
    line = upright if about == 'upright' else np.cross(laser.normal, upright)
    turn = np.asarray(cv2.Rodrigues(np.radians(degrees) * line)[0])
    # the laser module stands 0.35 m before the axis: there is its pivot
    pivot = T[:3, 3] + 0.35 * np.cross(laser.normal, upright)
    pivot -= laser.distance(pivot[None])[0] * laser.normal
    normal = turn @ laser.normal
    moved = replace(laser, normal=normal, offset=float(-normal @ pivot))
    lasers = (*cell.lasers[:index], moved, *cell.lasers[index + 1 :])
    return replace(cell, lasers=lasers)


def with_moved_table(cell: Cell, move_xyz: Floats, tilt: float = 0.0) -> Cell:
    """Return the cell with the table moved (meters, own frame) and tilted about x (radians)."""
    turn = np.asarray(cv2.Rodrigues(np.array([tilt, 0.0, 0.0]))[0], dtype=np.float64)
    moved = cell.turntable.camera_from_base @ transforms.rigid(turn, move_xyz)
    return replace(cell, turntable=replace(cell.turntable, camera_from_base=moved))


def with_focal_length(cell: Cell, fraction: float) -> Cell:
    """Return the cell with focal lengths longer by a fraction of them."""
    K = cell.camera.K.copy()
    K[0, 0] *= 1 + fraction
    K[1, 1] *= 1 + fraction
    return replace(cell, camera=replace(cell.camera, K=K))
