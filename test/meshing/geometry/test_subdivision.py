# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.geometry.areas import vertex_areas
from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.meshing.geometry.subdivision import split_long_edges
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import stepped_shaft

SOLIDS = [box((0.04, 0.001, 0.02)), stepped_shaft([(0.03, 0.02), (0.012, 0.02)])]


def edges(vertices, faces):
    corners = vertices[faces]
    return np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)


@pytest.mark.parametrize('solid', SOLIDS)
@pytest.mark.parametrize('longest', [0.0015, 0.006])
def test_surface_stays_and_no_edge_is_long(solid, longest):
    vertices, faces = split_long_edges(solid.vertices_xyz, solid.faces, longest)
    assert edges(vertices, faces).max() <= longest
    assert np.array_equal(vertices[: len(solid.vertices_xyz)], solid.vertices_xyz)
    # closed as before, each face on the side that it was on
    assert not len(topology.boundary_edges(faces))
    volume = np.linalg.det(vertices[faces]).sum() / 6
    assert volume == pytest.approx(np.linalg.det(solid.vertices_xyz[solid.faces]).sum() / 6)
    area = vertex_areas(solid.vertices_xyz, solid.faces).sum()
    assert vertex_areas(vertices, faces).sum() == pytest.approx(area)


def test_open_mesh_keeps_its_border():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    fine, faces = split_long_edges(vertices, np.array([[0, 1, 2], [0, 2, 3]]), 0.3)
    border = fine[np.unique(topology.boundary_edges(faces))]
    assert np.isin(border[:, :2], (0.0, 1.0)).any(axis=1).all()
    assert np.allclose(face_normals(fine, faces), (0, 0, 1))


def test_values_of_vertices_are_interpolated_and_what_is_not_known_stays_so():
    columns = np.array([[0.0, 0, 0, 1], [1, 0, 0, 3], [0, 1, 0, np.nan]])
    found, _ = split_long_edges(columns, np.array([[0, 1, 2]]), 0.9)
    value = {tuple(row[:3]): row[3] for row in found.tolist()}
    assert value[0.5, 0.0, 0.0] == 2.0
    assert np.isnan(value[0.5, 0.5, 0.0])
    assert np.isnan(value[0.0, 0.5, 0.0])


def test_many_vertices_of_small_integers_do_not_overflow():
    solid = SOLIDS[0]
    vertices, faces = split_long_edges(solid.vertices_xyz, solid.faces.astype(np.int32), 1e-4)
    assert len(vertices) > 50_000
    assert edges(vertices, faces).max() <= 1e-4


def test_mesh_of_short_edges_is_left_alone():
    solid = SOLIDS[0]
    vertices, faces = split_long_edges(solid.vertices_xyz, solid.faces, 1.0)
    assert vertices is solid.vertices_xyz
    assert faces is solid.faces
