# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laser light received along camera rays: light sheet profile, Lambert shading, shadows."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.optics import SHEET_EXTENT
from ivfmc_ros.simulation.render.optics import stripe_profile
from ivfmc_ros.simulation.render.scene import NO_FACE
from ivfmc_ros.simulation.render.scene import Scene


@dataclass(frozen=True, eq=False, kw_only=True)
class ShadingSetup:
    """
    Scene and illumination at one table position with one laser on.

    part_from_camera : (4, 4) rigid, turntable from camera_optical_frame, meters
    source : (3,) meters, ``turntable``, position of the laser
    sigma : meters, 1 sigma of the thickness of the light sheet
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
    Rays to shade, (n, 3) each, ``camera_optical_frame``.

    rays : of unit depth
    along_u, along_v : derivative of the ray by the pixel coordinates
    size : pixels, side of the square that each ray represents
    """

    rays: Floats
    along_u: Floats
    along_v: Floats
    size: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ShadedRays:
    """
    Result of ray casting and shading, (n,) each.

    depth : meters, infinite without an intersection
    face : of the scene, or NO_FACE
    near : within the light sheet, shadows not considered
    light : DN of laser light
    """

    depth: Floats
    face: Ints
    near: Bools
    light: Floats


def shade(setup: ShadingSetup, pixels: Pixels) -> ShadedRays:
    """Cast and shade the rays of ``pixels``."""
    turn, origin = setup.part_from_camera[:3, :3], setup.part_from_camera[:3, 3]
    depth, face = setup.scene.cast(origin, pixels.rays @ turn.T)
    near = face != NO_FACE
    points = pixels.rays[near] * depth[near, None]
    distance = setup.laser.distance(points)
    inside = np.abs(distance) < SHEET_EXTENT * setup.sigma
    near[near] = inside
    light = np.zeros(len(depth))
    light[near] = _light(setup, pixels, near, points[inside], distance[inside], face[near])
    return ShadedRays(depth=depth, face=face, near=near, light=light)


def _light(
    setup: ShadingSetup, pixels: Pixels, near: Bools, points: Floats, distance: Floats, face: Ints
) -> Floats:
    """Return the light (n,) from points (n, 3) in the light sheet, of the pixels ``near``."""
    normals = setup.scene.normals[face]
    turned = normals @ setup.part_from_camera[:3, :3]
    footprint = np.maximum(
        np.abs(
            _distance_change(setup.laser, turned, points, pixels.rays[near], pixels.along_u[near])
        ),
        np.abs(
            _distance_change(setup.laser, turned, points, pixels.rays[near], pixels.along_v[near])
        ),
    )
    at = transforms.apply(setup.part_from_camera, points)
    to_source = setup.source - at
    facing = np.einsum('ij,ij->i', to_source, normals) / np.linalg.norm(to_source, axis=1)
    facing_source = facing > 0
    facing[~facing_source] = 0.0
    facing[facing_source] *= ~setup.scene.in_shadow(
        at[facing_source], normals[facing_source], setup.source
    )
    profile = stripe_profile(distance, footprint * pixels.size, setup.sigma)
    return np.asarray(setup.peak * setup.scene.reflectance[face] * facing * profile)


def _distance_change(
    laser: LaserPlane, normals: Floats, points: Floats, rays: Floats, along: Floats
) -> Floats:
    """Return (n,) derivative of the distance from the laser plane by a pixel coordinate."""
    lift = np.einsum('ij,ij->i', normals, along) / np.einsum('ij,ij->i', normals, rays)
    return np.asarray(points[:, 2] * ((along - rays * lift[:, None]) @ laser.normal))
