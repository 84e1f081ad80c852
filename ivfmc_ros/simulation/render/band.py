# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which pixels can see the stripe: everything else of a picture need not be rendered."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.scene import Scene

# Pixels around the stripe that are needed too, to find its edges.
MARGIN = 3

# Points along a border, because a lens bends what is straight.
_BORDER = 9


def lit_faces(
    scene: Scene, part_from_camera: Floats, source: Floats, distance: Floats, reach: float
) -> Ints:
    """
    Return the faces that are in the sheet's reach and turned to camera and laser.

    source : (3,) metres, ``turntable``
    distance : (n,) metres, of the scene's vertices from the sheet
    """
    of_faces = distance[scene.faces]
    near = np.flatnonzero((of_faces.min(axis=1) < reach) & (of_faces.max(axis=1) > -reach))
    corner, normals = scene.vertices_xyz[scene.faces[near, 0]], scene.normals[near]
    seen = np.einsum('ij,ij->i', part_from_camera[:3, 3] - corner, normals) > 0
    lit = np.einsum('ij,ij->i', source - corner, normals) > 0
    return np.asarray(near[seen & lit], dtype=np.int64)


def stripe_pixels(
    scene: Scene,
    camera: Camera,
    laser: LaserPlane,
    part_from_camera: Floats,
    source: Floats,
    reach: float,
) -> NDArray[np.uint8]:
    """
    Return a mask, (height, width), that is not 0 wherever the stripe may be seen.

    source : (3,) metres, ``turntable``
    reach : metres, the distance from the sheet up to which there is light
    """
    vertices = transforms.apply(transforms.invert(part_from_camera), scene.vertices_xyz)
    distance = vertices @ laser.normal + laser.offset
    if laser.bow is not None and len(vertices):
        # the faces are cut along planes: make room for the bow
        reach += 2 * float(np.abs(distance - laser.distance(vertices)).max())
    chosen = scene.faces[lit_faces(scene, part_from_camera, source, distance, reach)]
    outlines = _cut(vertices[chosen], distance[chosen], reach)
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    pixels = np.rint(camera.project(outlines.reshape(-1, 3))).astype(np.int32)
    for outline in pixels.reshape(-1, 2 * _BORDER + 1, 2):
        cv2.fillPoly(mask, [outline], 255)
    return np.asarray(cv2.dilate(mask, np.ones((2 * MARGIN + 1,) * 2, np.uint8)), dtype=np.uint8)


def _cut(corners: Floats, distance: Floats, reach: float) -> Floats:
    """
    Return the outlines of what of each triangle lies between two parallel planes.

    corners : (n, 3, 3) metres; distance : (n, 3) metres, of each from the plane in the middle
    returns : (n, points, 3) metres
    """
    order = np.argsort(distance, axis=1)
    d = np.take_along_axis(distance, order, axis=1)
    p = np.take_along_axis(corners, order[..., None], axis=1)
    low, high = np.maximum(d[:, 0], -reach), np.minimum(d[:, 2], reach)
    # from the lowest corner to the highest: straight, or by way of the middle one
    along = np.linspace(0, 1, _BORDER)[:, None, None]
    border_low = (1 - along) * _between(p, d, 0, 2, low) + along * _bent(p, d, low)
    border_high = along * _between(p, d, 0, 2, high) + (1 - along) * _bent(p, d, high)
    middle = _bent(p, d, np.clip(d[:, 1], low, high))
    return np.concatenate([border_low, middle[None], border_high]).transpose(1, 0, 2)


def _bent(p: Floats, d: Floats, level: Floats) -> Floats:
    first = _between(p, d, 0, 1, level)
    return np.where((level < d[:, 1])[:, None], first, _between(p, d, 1, 2, level))


def _between(p: Floats, d: Floats, start: int, stop: int, level: Floats) -> Floats:
    """Return the (n, 3) points of an edge at which the distance is ``level``."""
    span = d[:, stop] - d[:, start]
    part = np.clip((level - d[:, start]) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    return np.asarray(p[:, start] + part[:, None] * (p[:, stop] - p[:, start]))
