# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of flat printed things in space, before the sensor."""

from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.simulation.boards.textures import Texture
from ivfmc_ros.simulation.render.optics import stripe_profile
from ivfmc_ros.simulation.render.raster import pixel_rays
from ivfmc_ros.simulation.render.sources import LaserSource

_SUPERSAMPLING = 4
_LENS_BLUR = 0.5  # pixels, 1 sigma


@dataclass(frozen=True, eq=False, kw_only=True)
class Beam:
    """
    One laser that is on.

    sigma : metres, thickness of its sheet
    peak : DN on a white surface that faces it
    """

    plane: LaserPlane
    source: LaserSource
    sigma: float
    peak: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Light:
    """
    Grey values without noise, each (height, width) float32.

    steady : what the room's light makes of the scene
    laser : what the stripe adds
    """

    steady: Singles
    laser: Singles


def dark(camera: Camera, ambient: float) -> Light:
    """Return an empty scene."""
    shape = (camera.height, camera.width)
    return Light(
        steady=np.full(shape, ambient, dtype=np.float32), laser=np.zeros(shape, dtype=np.float32)
    )


@dataclass(frozen=True, eq=False)
class _Patch:
    """
    The rectangle of pixels that a flat thing may be seen in.

    window : its rows and columns
    points_xyz : (height, width, 3) metres, where its pixels see the plane, camera_optical_frame
    x, y : (height, width) metres, the same in the plane
    """

    window: tuple[slice, slice]
    points_xyz: Floats
    x: Floats
    y: Floats


def lay(
    light: Light,
    camera: Camera,
    texture: Texture,
    camera_from_plane: Floats,
    *,
    level: float,
    beam: Beam | None,
) -> Light:
    """
    Return the scene with a flat thing in front of all that is in it.

    camera_from_plane : (4, 4) rigid; the print is on the side from which z points away
    level : DN of white in the room's light

    :raises GeometryError: the camera sees the back
    """
    toward = -camera_from_plane[:3, 2]
    if toward @ camera_from_plane[:3, 3] >= 0:
        raise GeometryError('the camera sees the back of the board; turn the board over')
    patch = _patch(camera, texture, camera_from_plane)
    if patch is None:
        return light
    albedo, cover = _sample(texture, patch)
    steady, laser = light.steady.copy(), light.laser.copy()
    room = level * albedo + light.steady.min() * cover
    steady[patch.window] = steady[patch.window] * (1 - cover) + room
    laser[patch.window] *= 1 - cover
    if beam is not None:
        laser[patch.window] += albedo * _stripe(patch, toward, beam)
    return Light(steady=steady, laser=laser)


def _patch(camera: Camera, texture: Texture, pose: Floats) -> _Patch | None:
    window = _window(camera, texture, pose)
    rays_xy = pixel_rays(camera)[window]
    rays = np.dstack([rays_xy, np.ones(rays_xy.shape[:2])])
    if not rays.size:
        return None
    normal = pose[:3, 2]
    # a ray along the plane, or one that would meet it behind the camera, sees it nowhere
    with np.errstate(divide='ignore', invalid='ignore'):
        depth = (normal @ pose[:3, 3]) / (rays @ normal)
        points = rays * np.where(depth > 0, depth, np.nan)[..., None]
    local = (points - pose[:3, 3]) @ pose[:3, :2]
    return _Patch(window, points, local[..., 0], local[..., 1])


def _window(camera: Camera, texture: Texture, pose: Floats) -> tuple[slice, slice]:
    """Return the rows and columns that hold the texture's outline, also where it is bowed."""
    corners = texture.outline_xy
    along = np.linspace(0, 1, 32, endpoint=False)[:, None]
    edges = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    outline = np.zeros((4 * 32, 3))
    outline[:, :2] = np.concatenate(edges)
    points = transforms.apply(pose, outline)
    if (points[:, 2] < 0.01).any():
        return slice(0, camera.height), slice(0, camera.width)
    uv = camera.project(points)
    least = np.maximum(np.floor(uv.min(axis=0)).astype(int) - 3, 0)
    most = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 4, camera.size)
    return slice(least[1], max(least[1], most[1])), slice(least[0], max(least[0], most[0]))


def _sample(texture: Texture, patch: _Patch) -> tuple[Singles, Singles]:
    """Return albedo (nothing counts as black) and coverage, averaged over every pixel."""
    x = (patch.x - texture.corner_xy[0]) / texture.texel - 0.5
    y = (patch.y - texture.corner_xy[1]) / texture.texel - 0.5
    printed = np.dstack([texture.albedo, np.asarray(texture.albedo > 0, dtype=np.float32)])
    x_v, x_u = np.gradient(x)
    y_v, y_u = np.gradient(y)
    total = np.zeros((*x.shape, 2), dtype=np.float32)
    steps = (np.arange(_SUPERSAMPLING) + 0.5) / _SUPERSAMPLING - 0.5
    for dv in steps:
        for du in steps:
            at_x = np.nan_to_num(x + du * x_u + dv * x_v, nan=-9.0).astype(np.float32)
            at_y = np.nan_to_num(y + du * y_u + dv * y_v, nan=-9.0).astype(np.float32)
            total += cv2.remap(printed, at_x, at_y, cv2.INTER_LINEAR, borderValue=0)
    total /= len(steps) ** 2
    blurred = np.asarray(cv2.GaussianBlur(total, (0, 0), _LENS_BLUR), dtype=np.float32)
    return blurred[..., 0], blurred[..., 1]


def _stripe(patch: _Patch, toward: Floats, beam: Beam) -> Singles:
    """Return the laser light on a white plane, DN."""
    distance = beam.plane.distance(patch.points_xyz.reshape(-1, 3)).reshape(patch.x.shape)
    footprint = np.maximum(*(np.abs(slope) for slope in np.gradient(distance)))
    to_source = beam.source.position - patch.points_xyz
    facing = to_source @ toward / np.linalg.norm(to_source, axis=2)
    profile = stripe_profile(distance, footprint, beam.sigma)
    light = beam.peak * np.clip(facing, 0.0, 1.0) * profile
    return np.asarray(np.nan_to_num(light), dtype=np.float32)
