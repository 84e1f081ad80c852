# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.integrate import integrate
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.settings import MeshSettings

VOXEL = 1e-3  # meters
DENSITY = 3.0  # samples per voxel^2
HEIGHT = 12.0  # voxels, of a cylinder


def samples_of(points, normals):
    """Return exact samples; points in voxels."""
    ones = np.ones(len(points))
    return SurfaceSamples(
        points_xyz=VOXEL * points,
        normals=normals,
        to_camera=normals,
        weight=ones / 30e-6**2,
        intensity=ones,
        systematic=0.0 * ones,
    )


def directions(seed, count):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def bias_of_sphere(radius, sign):
    """Return the mean distance of the vertices from the sphere, voxels; sign -1 for a cavity."""
    normals = directions(1, int(4 * np.pi * radius**2 * DENSITY))
    settings = MeshSettings(floor=None, close='none')
    mesh = integrate(samples_of(radius * normals, sign * normals), VOXEL, settings)
    return np.linalg.norm(mesh.vertices_xyz / VOXEL, axis=1).mean() - radius


def bias_of_cylinder(radius):
    rng = np.random.default_rng(2)
    angle = rng.uniform(0, 2 * np.pi, int(2 * np.pi * radius * HEIGHT * DENSITY))
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = radius * normals
    points[:, 2] = rng.uniform(-HEIGHT / 2, HEIGHT / 2, len(angle))
    # an axis along no axis of the voxels
    turn = np.linalg.qr(directions(3, 3))[0]
    samples = samples_of(points @ turn.T, normals @ turn.T)
    mesh = integrate(samples, VOXEL, MeshSettings(floor=None, close='none'))
    vertices = mesh.vertices_xyz @ turn / VOXEL
    middle = np.abs(vertices[:, 2]) < HEIGHT / 4
    return np.hypot(*vertices[middle, :2].T).mean() - radius


@pytest.mark.parametrize('radius', [8, 16])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_vertices_have_no_bias_on_a_sphere(radius, sign):
    # two curvatures of 1/radius; means of points on the surface would be 0.2/radius inside
    assert abs(bias_of_sphere(radius, sign)) < 0.03 / radius


@pytest.mark.parametrize('radius', [8, 16])
def test_vertices_have_no_bias_on_a_cylinder(radius):
    assert abs(bias_of_cylinder(radius)) < 0.02 / radius
