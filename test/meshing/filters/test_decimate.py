# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.filters.decimate import decimate
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.model import BASE
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface


def fine_box():
    import open3d as o3d

    solid = box((0.02, 0.03, 0.05))
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(solid.vertices_xyz), o3d.utility.Vector3iVector(solid.faces)
    ).subdivide_midpoint(4)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    low = (vertices[faces][:, :, 2] < 1e-9).all(axis=1)
    return Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=normals.vertex_normals(vertices, faces),
        sigma=np.full(len(vertices), 1e-5),
        intensity=np.full(len(vertices), 50.0),
        kind=np.where(low, BASE, MEASURED).astype(np.uint8),
    )


def test_flat_faces_are_decimated_within_the_tolerance():
    mesh = fine_box()
    small, error = decimate(mesh, 5e-6)
    assert len(small.faces) < 0.3 * len(mesh.faces)
    assert error <= 5e-6
    apart = Surface(small.vertices_xyz, small.faces).nearest(mesh.vertices_xyz).distance
    assert apart.max() <= 5e-6
    bottom = (small.vertices_xyz[small.faces][:, :, 2] < 1e-9).all(axis=1)
    assert ((small.kind == BASE) == bottom).mean() > 0.95


def test_rough_surface_is_not_decimated_with_a_small_tolerance():
    rng = np.random.default_rng(0)
    mesh = fine_box()
    bumpy = mesh.vertices_xyz + rng.normal(scale=2e-4, size=mesh.vertices_xyz.shape)
    rough = Mesh(
        vertices_xyz=bumpy,
        faces=mesh.faces,
        normals=normals.vertex_normals(bumpy, mesh.faces),
        sigma=mesh.sigma,
        intensity=mesh.intensity,
    )
    same, error = decimate(rough, 1e-7)
    assert len(same.faces) == len(rough.faces)
    assert error == pytest.approx(0.0)
