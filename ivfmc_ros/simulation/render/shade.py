# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much laser light comes to the camera along given rays."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.optics import SHEET_EDGE
from ivfmc_ros.simulation.render.optics import stripe_profile
from ivfmc_ros.simulation.render.scene import NOTHING
from ivfmc_ros.simulation.render.scene import Scene


@dataclass(frozen=True, eq=False, kw_only=True)
class Stage:
    """
    One table position with one laser on.

    part_from_camera : (4, 4) turntable <- camera_optical_frame
    source : (3,) metres, ``turntable``
    sigma : metres, thickness of the sheet
    peak : DN on a white surface that faces the laser
    """

    scene: Scene
    laser: LaserPlane
    part_from_camera: Floats
    source: Floats
    sigma: float
    peak: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Pixels:
    """
    Rays to follow, (n, 3) each, ``camera_optical_frame``.

    rays : of unit depth
    along_u, along_v : by how much the ray changes over a pixel
    size : pixels, the side of the square that each ray stands for
    """

    rays: Floats
    along_u: Floats
    along_v: Floats
    size: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """
    What rays see, (n,) each.

    depth : metres, infinite for nothing
    face : of the scene, or NOTHING
    near : in the sheet, if it were not shaded
    light : DN of laser light
    """

    depth: Floats
    face: Ints
    near: Bools
    light: Floats


def shade(stage: Stage, pixels: Pixels) -> Seen:
    """Return what ``pixels`` see."""
    turn, origin = stage.part_from_camera[:3, :3], stage.part_from_camera[:3, 3]
    depth, face = stage.scene.cast(origin, pixels.rays @ turn.T)
    near = face != NOTHING
    points = pixels.rays[near] * depth[near, None]
    distance = stage.laser.distance(points)
    inside = np.abs(distance) < SHEET_EDGE * stage.sigma
    near[near] = inside
    light = np.zeros(len(depth))
    light[near] = _light(stage, pixels, near, points[inside], distance[inside], face[near])
    return Seen(depth=depth, face=face, near=near, light=light)


def _light(
    stage: Stage, pixels: Pixels, near: Bools, points: Floats, distance: Floats, face: Ints
) -> Floats:
    """Return the light from points (n, 3) in the sheet, whose pixels are ``near``."""
    normals = stage.scene.normals[face]
    turned = normals @ stage.part_from_camera[:3, :3]
    footprint = np.maximum(
        np.abs(_slope(stage.laser, turned, points, pixels.rays[near], pixels.along_u[near])),
        np.abs(_slope(stage.laser, turned, points, pixels.rays[near], pixels.along_v[near])),
    )
    at = transforms.apply(stage.part_from_camera, points)
    to_source = stage.source - at
    facing = np.einsum('ij,ij->i', to_source, normals) / np.linalg.norm(to_source, axis=1)
    turned_to = facing > 0
    facing[~turned_to] = 0.0
    facing[turned_to] *= ~stage.scene.shaded(at[turned_to], normals[turned_to], stage.source)
    profile = stripe_profile(distance, footprint * pixels.size, stage.sigma)
    return np.asarray(stage.peak * stage.scene.reflectance[face] * facing * profile)


def _slope(
    laser: LaserPlane, normals: Floats, points: Floats, rays: Floats, along: Floats
) -> Floats:
    """Return by how much the distance from the sheet changes from a pixel to the next."""
    lift = np.einsum('ij,ij->i', normals, along) / np.einsum('ij,ij->i', normals, rays)
    return np.asarray(points[:, 2] * ((along - rays * lift[:, None]) @ laser.normal))
