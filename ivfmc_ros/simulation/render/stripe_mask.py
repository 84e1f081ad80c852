# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mask of the pixels that may see the laser stripe: only these are rendered."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.scene import Scene

# Pixels around the stripe that are rendered too, for the detection of edges.
MARGIN = 3

# Points along each border of a polygon: lens distortion bends straight lines.
_BORDER_POINTS = 9


def lit_faces(
    scene: Scene, part_from_camera: Floats, source: Floats, distance: Floats, max_distance: float
) -> Ints:
    """
    Return the faces near the laser plane that face both camera and laser.

    source : (3,) meters, ``turntable``, position of the laser
    distance : (n,) meters, signed, of the scene's vertices from the laser plane
    max_distance : meters, of a face from the laser plane
    returns : (m,) int64
    """
    of_faces = distance[scene.faces]
    near = np.flatnonzero(
        (of_faces.min(axis=1) < max_distance) & (of_faces.max(axis=1) > -max_distance)
    )
    corner, normals = scene.vertices_xyz[scene.faces[near, 0]], scene.normals[near]
    seen = np.einsum('ij,ij->i', part_from_camera[:3, 3] - corner, normals) > 0
    lit = np.einsum('ij,ij->i', source - corner, normals) > 0
    return np.asarray(near[seen & lit], dtype=np.int64)


def stripe_mask(
    scene: Scene,
    camera: Camera,
    laser: LaserPlane,
    part_from_camera: Floats,
    source: Floats,
    max_distance: float,
) -> NDArray[np.uint8]:
    """
    Return a mask, (height, width) uint8, that is not 0 where the stripe may be visible.

    source : (3,) meters, ``turntable``, position of the laser
    max_distance : meters from the laser plane, up to which there is light
    """
    vertices = transforms.apply(transforms.invert(part_from_camera), scene.vertices_xyz)
    distance = vertices @ laser.normal + laser.offset
    if laser.bow is not None and len(vertices):
        # the faces are clipped by planes: widen the slab by the bow
        max_distance += 2 * float(np.abs(distance - laser.distance(vertices)).max())
    chosen = scene.faces[lit_faces(scene, part_from_camera, source, distance, max_distance)]
    outlines = _clip_to_sheet(vertices[chosen], distance[chosen], max_distance)
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    pixels = np.rint(camera.project(outlines.reshape(-1, 3))).astype(np.int32)
    for outline in pixels.reshape(-1, 2 * _BORDER_POINTS + 1, 2):
        cv2.fillPoly(mask, [outline], 255)
    return np.asarray(cv2.dilate(mask, np.ones((2 * MARGIN + 1,) * 2, np.uint8)), dtype=np.uint8)


def _clip_to_sheet(corners: Floats, distance: Floats, max_distance: float) -> Floats:
    """
    Clip triangles by the slab between two planes parallel to the laser plane.

    corners : (n, 3, 3) meters
    distance : (n, 3) meters, signed, of each corner from the laser plane
    returns : (n, points, 3) meters
    """
    order = np.argsort(distance, axis=1)
    d = np.take_along_axis(distance, order, axis=1)
    p = np.take_along_axis(corners, order[..., None], axis=1)
    low, high = np.maximum(d[:, 0], -max_distance), np.minimum(d[:, 2], max_distance)
    # from the lowest corner to the highest: directly, or along the two other edges
    along = np.linspace(0, 1, _BORDER_POINTS)[:, None, None]
    border_low = (1 - along) * _between(p, d, 0, 2, low) + along * _along_two_edges(p, d, low)
    border_high = along * _between(p, d, 0, 2, high) + (1 - along) * _along_two_edges(p, d, high)
    middle = _along_two_edges(p, d, np.clip(d[:, 1], low, high))
    return np.concatenate([border_low, middle[None], border_high]).transpose(1, 0, 2)


def _along_two_edges(p: Floats, d: Floats, level: Floats) -> Floats:
    first = _between(p, d, 0, 1, level)
    return np.where((level < d[:, 1])[:, None], first, _between(p, d, 1, 2, level))


def _between(p: Floats, d: Floats, start: int, stop: int, level: Floats) -> Floats:
    """Return the (n, 3) points of an edge at which the distance is ``level``."""
    span = d[:, stop] - d[:, start]
    part = np.clip((level - d[:, start]) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    return np.asarray(p[:, start] + part[:, None] * (p[:, stop] - p[:, start]))
