# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Corners of a dark square as intersections of its edges, each a line through many pixels."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

_REACH = 3.0  # pixels to both sides of an edge
_SUBSAMPLES = 4  # a pixel across the edge
_CLEAR = 0.12  # share of an edge at both ends that the other edges disturb
_ROUNDS = 3
_MAX_MOVE = 3.0  # pixels; a corner that goes further was no corner of this square


def refine_square(gray: NDArray[np.uint8], quad: Floats) -> Floats:
    """
    Place the corners of a dark square on light ground.

    An edge is where the grey value changes most: the centre of mass of the gradient across it,
    then a robust line along it. Both sides of a blurred edge lie where they should only if the
    camera is linear; else the square comes out a little small on all sides alike.

    quad : (4, 2) pixel, to 2 pixels
    returns : (4, 2) pixel; the same as ``quad`` where edges cannot be followed
    """
    corners = quad.copy()
    for _ in range(_ROUNDS):
        lines = [_edge(gray, corners[i], corners[(i + 1) % 4]) for i in range(4)]
        if any(line is None for line in lines):
            return quad
        moved = np.array([_meet(lines[i - 1], lines[i]) for i in range(4)])
        if not np.isfinite(moved).all() or np.abs(moved - quad).max() > _MAX_MOVE:
            return quad
        corners = moved
    return corners


def _edge(gray: NDArray[np.uint8], a: Floats, b: Floats) -> Floats | None:
    """Return the line (3,) n.x + c = 0 of the edge from ``a`` to ``b``; None if there is none."""
    length = float(np.linalg.norm(b - a))
    if length < 6.0:
        return None
    along = (b - a) / length
    across = np.array([along[1], -along[0]])
    count = max(int(2 * length * (1 - 2 * _CLEAR)), 6)
    places = a + np.linspace(_CLEAR, 1 - _CLEAR, count)[:, None] * (b - a)
    reach = min(_REACH, 0.12 * length + 1.0)
    steps = np.arange(-reach, reach + 1e-9, 1.0 / _SUBSAMPLES)
    grid = places[:, None] + steps[:, None] * across
    values = sample(gray, grid)
    gradient = np.diff(values, axis=1)
    gradient *= np.sign(
        gradient.sum()
    )  # outwards it gets lighter, or darker if the sense is other
    gradient = np.maximum(gradient, 0.0)
    total = gradient.sum(axis=1)
    good = total > 0.3 * np.median(total)
    if good.sum() < 6 or np.median(total) < 5.0:
        return None
    middle = 0.5 * (steps[1:] + steps[:-1])
    offset = (gradient[good] @ middle) / total[good]
    return _robust_line(places[good] + offset[:, None] * across)


def sample(image: Image, uv: Floats) -> Floats:
    """Return the values of a picture at (n, m, 2) pixels, (n, m), by bilinear interpolation."""
    u, v = uv[..., 0].astype(np.float32), uv[..., 1].astype(np.float32)
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float64)


def _robust_line(points: Floats) -> Floats | None:
    keep = np.ones(len(points), dtype=bool)
    for _ in range(4):
        if keep.sum() < 6:
            return None
        center = points[keep].mean(axis=0)
        normal = np.linalg.svd(points[keep] - center, full_matrices=False)[2][1]
        off = np.abs((points - center) @ normal)
        keep = off <= max(3.0 * 1.4826 * float(np.median(off[keep])), 0.05)
    return np.append(normal, -normal @ center)


def _meet(one: Floats | None, other: Floats | None) -> Floats:
    if one is None or other is None:
        return np.full(2, np.nan)
    point = np.cross(one, other)
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(point[:2] / point[2])


def inward(quad: Floats) -> Floats:
    """
    Return how corners move if each edge moves inwards by one pixel.

    quad : (4, 2) pixel
    returns : (4, 2)
    """
    sides = np.roll(quad, -1, axis=0) - quad
    normals = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign((normals * (quad.mean(axis=0) - quad)).sum(axis=1, keepdims=True))
    pairs = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    return np.asarray(np.linalg.solve(pairs, np.ones((4, 2, 1)))[..., 0])
