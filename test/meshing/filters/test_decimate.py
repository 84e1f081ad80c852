# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.degraded_views import CELL
from support.degraded_views import views

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.filters.decimate import decimate
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import BASE
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
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


def test_borders_of_each_kind_keep_their_vertices():
    mesh = fine_box()
    open_box = Mesh(
        vertices_xyz=mesh.vertices_xyz,
        faces=mesh.faces[mesh.vertices_xyz[mesh.faces][:, :, 2].min(axis=1) < 0.045],
        normals=mesh.normals,
        sigma=mesh.sigma,
        intensity=mesh.intensity,
        kind=mesh.kind[mesh.vertices_xyz[mesh.faces][:, :, 2].min(axis=1) < 0.045],
    )
    small, _ = decimate(open_box, 5e-6)
    assert border(open_box.vertices_xyz, open_box.faces) == border(small.vertices_xyz, small.faces)
    for kind in (BASE, MEASURED):
        before, after = (
            border(one.vertices_xyz, one.faces[one.kind == kind]) for one in (open_box, small)
        )
        assert before == after


def border(vertices, faces):
    """Return the vertices at open borders of faces, to the last bit."""
    return {tuple(vertices[k]) for k in np.unique(topology.boundary_edges(faces))}


def test_decimated_mesh_is_a_closed_manifold():
    rng = np.random.default_rng(1)
    mesh = fine_box()
    bumpy = mesh.vertices_xyz + rng.normal(scale=2e-6, size=mesh.vertices_xyz.shape)
    rough = replace(mesh, vertices_xyz=bumpy)
    small, error = decimate(rough, 2e-5)
    assert len(small.faces) < 0.5 * len(rough.faces)
    assert 0.0 < error <= 2e-5
    assert small.decimation_deviation == error
    assert not len(topology.boundary_edges(small.faces))
    assert topology.faces_without_bow_ties(small.faces, len(small.vertices_xyz)).all()


def test_mesh_of_a_scan_is_decimated_within_a_quarter_of_sigma():
    scanned = views()
    settings = MeshSettings(floor=None, decimate_sigmas=0.25)
    full = build_mesh(CELL, scanned, Poses.identity(2), replace(settings, decimate_sigmas=0.0))
    mesh = build_mesh(CELL, scanned, Poses.identity(2), settings)
    sigma = np.concatenate([view.sigma[view.valid] for view in scanned])
    assert 0.0 < mesh.decimation_deviation <= 0.25 * np.median(sigma)
    assert full.decimation_deviation == 0.0
    # a sphere is flat nowhere: within 2.5 micrometers it needs most of its faces
    assert len(mesh.faces) < 0.7 * len(full.faces)


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


@pytest.mark.parametrize('name', ['decimate', 'decimate_sigmas'])
def test_missing_library_is_named_before_a_scan(monkeypatch, name):
    monkeypatch.setattr('ivfmc_ros.meshing.settings.find_spec', lambda _: None)
    MeshSettings()
    with pytest.raises(ParameterError, match='pip install fast-simplification'):
        MeshSettings(**{name: 1e-5})
