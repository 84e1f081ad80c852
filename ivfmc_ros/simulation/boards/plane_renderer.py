# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Noise-free images of textured planes under ambient light and a laser stripe."""

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
from ivfmc_ros.simulation.render.camera_rays import pixel_rays
from ivfmc_ros.simulation.render.optics import stripe_profile
from ivfmc_ros.simulation.render.sources import LaserSource

_SUPERSAMPLING = 4  # rays per pixel and direction
_LENS_BLUR = 0.5  # pixels, 1 sigma


@dataclass(frozen=True, eq=False, kw_only=True)
class LightBeam:
    """
    One laser that is on.

    sigma : meters, 1 sigma of the thickness of the light sheet
    peak : DN on a white surface that faces the laser
    """

    plane: LaserPlane
    source: LaserSource
    sigma: float
    peak: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneLight:
    """
    Gray values (DN) without noise, each (height, width) float32.

    steady : by ambient light
    laser : by the laser stripe
    """

    steady: Singles
    laser: Singles


def ambient_light(camera: Camera, ambient: float) -> SceneLight:
    """Return an image of nothing but ambient light, DN."""
    shape = (camera.height, camera.width)
    return SceneLight(
        steady=np.full(shape, ambient, dtype=np.float32), laser=np.zeros(shape, dtype=np.float32)
    )


@dataclass(frozen=True, eq=False)
class _PlanePixels:
    """
    The rectangle of pixels that contains the image of a textured plane.

    window : rows and columns
    points_xyz : (height, width, 3) meters, the plane at each pixel, camera_optical_frame
    x, y : (height, width) meters, the same in the plane
    """

    window: tuple[slice, slice]
    points_xyz: Floats
    x: Floats
    y: Floats


def composite(
    light: SceneLight,
    camera: Camera,
    texture: Texture,
    camera_from_plane: Floats,
    *,
    level: float,
    beam: LightBeam | None,
) -> SceneLight:
    """
    Return the image with a textured plane in front of everything in it.

    camera_from_plane : (4, 4) rigid, meters; z points away from the printed side
    level : DN of white in ambient light

    :raises GeometryError: the camera sees the back of the plane
    """
    toward = -camera_from_plane[:3, 2]
    if toward @ camera_from_plane[:3, 3] >= 0:
        raise GeometryError('the camera sees the back of the board; turn the board over')
    pixels = _plane_pixels(camera, texture, camera_from_plane)
    if pixels is None:
        return light
    albedo, cover = _sample(texture, pixels)
    steady, laser = light.steady.copy(), light.laser.copy()
    room = level * albedo + light.steady.min() * cover
    steady[pixels.window] = steady[pixels.window] * (1 - cover) + room
    laser[pixels.window] *= 1 - cover
    if beam is not None:
        laser[pixels.window] += albedo * _stripe(pixels, toward, beam)
    return SceneLight(steady=steady, laser=laser)


def _plane_pixels(camera: Camera, texture: Texture, pose: Floats) -> _PlanePixels | None:
    window = _window(camera, texture, pose)
    rays_xy = pixel_rays(camera)[window]
    rays = np.dstack([rays_xy, np.ones(rays_xy.shape[:2])])
    if not rays.size:
        return None
    normal = pose[:3, 2]
    # NaN for rays parallel to the plane or that meet it behind the camera
    with np.errstate(divide='ignore', invalid='ignore'):
        depth = (normal @ pose[:3, 3]) / (rays @ normal)
        points = rays * np.where(depth > 0, depth, np.nan)[..., None]
    local = (points - pose[:3, 3]) @ pose[:3, :2]
    return _PlanePixels(window, points, local[..., 0], local[..., 1])


def _window(camera: Camera, texture: Texture, pose: Floats) -> tuple[slice, slice]:
    """Return the rows and columns that contain the texture's outline under lens distortion."""
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


def _sample(texture: Texture, pixels: _PlanePixels) -> tuple[Singles, Singles]:
    """Return albedo (0 outside the texture) and coverage, averaged over every pixel."""
    x = (pixels.x - texture.corner_xy[0]) / texture.texel - 0.5
    y = (pixels.y - texture.corner_xy[1]) / texture.texel - 0.5
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


def _stripe(pixels: _PlanePixels, toward: Floats, beam: LightBeam) -> Singles:
    """Return the laser light on a white plane, (height, width) DN."""
    distance = beam.plane.distance(pixels.points_xyz.reshape(-1, 3)).reshape(pixels.x.shape)
    footprint = np.maximum(*(np.abs(derivative) for derivative in np.gradient(distance)))
    to_source = beam.source.position - pixels.points_xyz
    facing = to_source @ toward / np.linalg.norm(to_source, axis=2)
    profile = stripe_profile(distance, footprint, beam.sigma)
    light = beam.peak * np.clip(facing, 0.0, 1.0) * profile
    return np.asarray(np.nan_to_num(light), dtype=np.float32)
