# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sub-pixel corners of a dark square: a line fitted to each edge, and their intersections."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image

_HALF_WINDOW = 3.0  # pixels sampled to both sides of an edge
_SUBSAMPLES = 4  # samples per pixel across the edge
_END_MARGIN = 0.12  # fraction of an edge left out at both ends, where the other edges disturb
_MAX_ITERATIONS = 3
_MAX_CORRECTION = 3.0  # pixels; a larger correction belongs to another structure


def refine_quad(gray: NDArray[np.uint8], quad: Floats) -> Floats:
    """
    Refine the corners of a dark square on a light background.

    Across each edge the position is the centroid of the gradient; along it a line is fitted
    robustly. With a camera whose response is not linear the square appears a little too small,
    by the same amount on all sides (see ``bloom_jacobian``).

    quad : (4, 2) pixel, accurate to 2 pixels
    returns : (4, 2) pixel; ``quad`` itself where an edge cannot be fitted
    """
    corners = quad.copy()
    for _ in range(_MAX_ITERATIONS):
        lines = [_fit_edge(gray, corners[i], corners[(i + 1) % 4]) for i in range(4)]
        if any(line is None for line in lines):
            return quad
        moved = np.array([_intersection(lines[i - 1], lines[i]) for i in range(4)])
        if not np.isfinite(moved).all() or np.abs(moved - quad).max() > _MAX_CORRECTION:
            return quad
        corners = moved
    return corners


def _fit_edge(gray: NDArray[np.uint8], a: Floats, b: Floats) -> Floats | None:
    """Return the line (3,) n.x + c = 0 of the edge from ``a`` to ``b``; None without an edge."""
    length = float(np.linalg.norm(b - a))
    if length < 6.0:
        return None
    along = (b - a) / length
    across = np.array([along[1], -along[0]])
    count = max(int(2 * length * (1 - 2 * _END_MARGIN)), 6)
    places = a + np.linspace(_END_MARGIN, 1 - _END_MARGIN, count)[:, None] * (b - a)
    half_window = min(_HALF_WINDOW, 0.12 * length + 1.0)
    steps = np.arange(-half_window, half_window + 1e-9, 1.0 / _SUBSAMPLES)
    grid = places[:, None] + steps[:, None] * across
    values = sample_bilinear(gray, grid)
    gradient = np.diff(values, axis=1)
    # positive for both orders of the corners
    gradient *= np.sign(gradient.sum())
    gradient = np.maximum(gradient, 0.0)
    total = gradient.sum(axis=1)
    good = total > 0.3 * np.median(total)
    if good.sum() < 6 or np.median(total) < 5.0:
        return None
    middle = 0.5 * (steps[1:] + steps[:-1])
    offset = (gradient[good] @ middle) / total[good]
    return _fit_line(places[good] + offset[:, None] * across)


def sample_bilinear(image: Image, uv: Floats) -> Floats:
    """Return (n, m) values of a picture at (n, m, 2) pixels, by bilinear interpolation."""
    u, v = uv[..., 0].astype(np.float32), uv[..., 1].astype(np.float32)
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float64)


def _fit_line(points: Floats) -> Floats | None:
    keep = np.ones(len(points), dtype=bool)
    for _ in range(4):
        if keep.sum() < 6:
            return None
        center = points[keep].mean(axis=0)
        normal = np.linalg.svd(points[keep] - center, full_matrices=False)[2][1]
        off = np.abs((points - center) @ normal)
        keep = off <= max(3.0 * 1.4826 * float(np.median(off[keep])), 0.05)
    return np.append(normal, -normal @ center)


def _intersection(one: Floats | None, other: Floats | None) -> Floats:
    if one is None or other is None:
        return np.full(2, np.nan)
    point = np.cross(one, other)
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(point[:2] / point[2])


def bloom_jacobian(quad: Floats) -> Floats:
    """
    Return the displacement of each corner if every edge moves inwards by one pixel.

    Blooming of light paper does this to a dark square.

    quad : (4, 2) pixel
    returns : (4, 2) pixel per pixel
    """
    sides = np.roll(quad, -1, axis=0) - quad
    normals = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign((normals * (quad.mean(axis=0) - quad)).sum(axis=1, keepdims=True))
    adjacent = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    return np.asarray(np.linalg.solve(adjacent, np.ones((4, 2, 1)))[..., 0])
