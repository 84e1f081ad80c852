# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import make_profile
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.meshing.paper.range_mesh import range_mesh
from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.registration.views.assemble import without

CELL = small_cell()
SPHERE = Sphere(np.array([0.006, 0.003, 0.045]), 0.02)
EDGE = 4e-3


def sphere_view(steps=60, **sweep):
    (view,) = assemble(CELL, sphere_profiles(CELL, SPHERE, steps, **sweep))
    return view


def border(faces):
    """Return the number of boundary edges."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    counts = Counter(map(tuple, np.sort(edges, axis=1).tolist()))
    return sum(count == 1 for count in counts.values())


def edge_lengths(mesh):
    corners = mesh.vertices_xyz[mesh.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


@pytest.mark.parametrize('laser', [0, 1])
def test_faces_look_outward(laser):
    mesh = range_mesh(CELL, sphere_view(laser=laser), EDGE)
    assert len(mesh.faces) > 5000
    middle = mesh.vertices_xyz[mesh.faces].mean(axis=1) - SPHERE.center
    outward = (face_normals(mesh.vertices_xyz, mesh.faces) * middle).sum(axis=1)
    assert (outward > 0.5 * SPHERE.radius).all()
    normals = (mesh.vertices_xyz - SPHERE.center) / SPHERE.radius
    assert (mesh.normals * normals).sum(axis=1).min() > 0.95
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(len(mesh.normals)))


def test_vertices_are_measured_points():
    view = sphere_view()
    mesh = range_mesh(CELL, view, EDGE)
    assert np.abs(SPHERE.distance(mesh.vertices_xyz)).max() < 1e-12
    assert len(np.unique(mesh.vertices_xyz, axis=0)) == len(mesh.vertices_xyz)
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices_xyz)))
    assert (mesh.sigma == 1e-5).all()
    assert (mesh.intensity == 100.0).all()


def test_seam_of_a_full_turn_is_closed():
    closed = range_mesh(CELL, sphere_view(60), EDGE)
    angles = np.arctan2(*(closed.vertices_xyz - SPHERE.center)[:, 1::-1].T)
    # a band around the sphere: its two rims, one above and one below, and no seam
    heights = closed.vertices_xyz[:, 2]
    middle = np.abs(heights - np.median(heights)) < 3e-3
    faces = closed.faces[middle[closed.faces].any(axis=1)]
    inner = closed.faces[middle[closed.faces].all(axis=1)]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    counts = Counter(map(tuple, np.sort(edges, axis=1).tolist()))
    inner_edges = np.concatenate([inner[:, [0, 1]], inner[:, [1, 2]], inner[:, [2, 0]]])
    assert {counts[tuple(edge)] for edge in np.sort(inner_edges, axis=1).tolist()} == {2}
    assert np.ptp(angles) > 6.2


def test_seam_of_a_part_of_a_turn_is_open():
    view = sphere_view(60)
    cut = replace(
        view,
        points_xyz=view.points_xyz[:, :50],
        intensity=view.intensity[:, :50],
        sigma=view.sigma[:, :50],
        uv=view.uv[:, :50],
        angles=view.angles[:50],
        seqs=view.seqs[:50],
    )
    assert border(range_mesh(CELL, cut, EDGE).faces) > border(range_mesh(CELL, view, EDGE).faces)


def test_no_edge_is_longer_than_the_threshold():
    view = sphere_view()
    whole = range_mesh(CELL, view, EDGE)
    longest = edge_lengths(whole).max()
    assert longest < EDGE
    threshold = float(np.median(edge_lengths(whole).max(axis=1)))
    fewer = range_mesh(CELL, view, threshold)
    assert 0 < len(fewer.faces) < len(whole.faces)
    assert edge_lengths(fewer).max() < threshold


def test_jump_is_not_bridged():
    # half of the profiles 5 mm farther out: an edge longer than the threshold
    view = sphere_view()
    points = view.points_xyz.copy()
    points[:, 20:40] += 5e-3 * np.nan_to_num((points[:, 20:40] - SPHERE.center) / SPHERE.radius)
    mesh = range_mesh(CELL, replace(view, points_xyz=points), EDGE)
    raised = SPHERE.distance(mesh.vertices_xyz) > 2.5e-3
    assert 0 < raised.sum() < len(raised)
    of_face = raised[mesh.faces]
    assert (of_face.all(axis=1) | ~of_face.any(axis=1)).all()


def flat_view(columns=4, rows=5, hole=None):
    """
    A facet that faces the camera and the laser, as a sweep of equal steps along the table.

    The profiles shift against the sense of rotation, as on a real part.
    """
    eye = np.array([1.0, 0.0, 0.36])
    along = np.array([0.0, -1.0, 0.0])
    down = np.array([0.34, 0.0, -0.94])
    profiles = []
    for column in range(columns):
        start = 0.02 * eye + column * 5e-4 * along
        points = start + np.arange(rows)[:, None] * 5e-4 * down
        kept = [r for r in range(rows) if (r, column) != hole]
        uv = np.stack([np.full(len(kept), 300.0), 200.0 + np.array(kept)], axis=1)
        profiles.append(make_profile(points[kept], uv=uv, angle=0.001 * column, seq=column))
    (view,) = assemble(CELL, profiles)
    return view


def test_four_neighbours_make_two_triangles():
    mesh = range_mesh(CELL, flat_view(4, 5), EDGE)
    assert len(mesh.faces) == 2 * 3 * 4
    assert len(mesh.vertices_xyz) == 20


@pytest.mark.parametrize(
    ('hole', 'faces'),
    # a corner costs one triangle, a rim point two (of 4 in its two cells), an inner one four
    [((0, 0), 23), ((4, 0), 23), ((0, 3), 23), ((4, 3), 23), ((0, 1), 22), ((2, 1), 20)],
)
def test_three_neighbours_make_one_triangle(hole, faces):
    assert len(range_mesh(CELL, flat_view(4, 5, hole), EDGE).faces) == faces


@pytest.mark.parametrize('corner', [(0, 0), (0, 3), (4, 0), (4, 3), (0, 1), (2, 1)])
def test_point_that_is_not_chosen_counts_as_a_hole(corner):
    chosen = np.ones((512, 4), dtype=bool)
    chosen[200 + corner[0], corner[1]] = False
    by_choice = range_mesh(CELL, flat_view(4, 5), EDGE, chosen)
    by_hole = range_mesh(CELL, flat_view(4, 5, corner), EDGE)
    assert len(by_choice.faces) == len(by_hole.faces)


def test_cell_is_split_along_the_shorter_diagonal():
    view = flat_view(2, 2)
    points = view.points_xyz.copy()
    # shear the right column down: the diagonal from the lower left to the upper right is shorter
    points[200:202, 1] += 4e-4 * np.array([0.34, 0.0, -0.94])
    sheared = range_mesh(CELL, replace(view, points_xyz=points), EDGE)
    diagonal = np.linalg.norm(points[201, 0] - points[200, 1])
    assert np.isclose(edge_lengths(sheared), diagonal, rtol=1e-12).sum() == 2


@pytest.mark.parametrize(('columns', 'rows'), [(1, 5), (5, 1), (1, 1)])
def test_single_line_has_no_triangles(columns, rows):
    mesh = range_mesh(CELL, flat_view(columns, rows), EDGE)
    assert mesh.faces.shape == (0, 3)
    assert mesh.vertices_xyz.shape == (0, 3)


def test_empty_view_has_no_triangles():
    view = sphere_view(12)
    empty = without(view, np.ones(view.valid.shape, dtype=bool))
    assert range_mesh(CELL, empty, EDGE).faces.shape == (0, 3)
