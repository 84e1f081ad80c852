# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.paper.zipper import remove_redundant
from ivfmc_ros.meshing.paper.zipper import zipper_views
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.registration.views.assemble import without

CELL = small_cell()
# wide and low: its top is crossed on both sides of the axis
SPHERE = Sphere(np.array([0.004, 0.002, 0.03]), 0.025)
EDGE = 4e-3


def sphere_view(laser=0, view=0, steps=60):
    (found,) = assemble(CELL, sphere_profiles(CELL, SPHERE, steps, laser=laser, view=view))
    return found


def area(mesh):
    corners = mesh.vertices_xyz[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * np.linalg.norm(across, axis=1).sum()


def flat(z=0.0, count=20, step=1e-3, flip=False, shift=0.0):
    """Return a square sheet at height z that faces up, or down."""
    y, x = np.meshgrid(np.arange(count) * step, np.arange(count) * step + shift, indexing='ij')
    points = np.stack([x, y, np.full_like(x, z)], axis=2).reshape(-1, 3)
    index = np.arange(count * count).reshape(count, count)
    a, b, c, d = (
        i.ravel() for i in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    faces = faces[:, ::-1] if flip else faces
    ones = np.ones(len(points))
    return Mesh(
        vertices_xyz=points,
        faces=faces,
        normals=normals.vertex_normals(points, faces),
        sigma=1e-5 * ones,
        intensity=100 * ones,
    )


def test_overlapping_surface_is_redundant():
    again = remove_redundant(flat(z=2e-4), flat(), max_distance=1e-3)
    assert len(again.faces) == 0
    assert len(again.vertices_xyz) == 0


def test_new_faces_are_kept_without_unused_vertices():
    # shifted by half its width: the faces over the free half stay, and those across its edge
    mesh = remove_redundant(flat(shift=10e-3), flat(), max_distance=0.6e-3)
    assert len(mesh.faces) == 2 * 19 * 10
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices_xyz)))
    assert mesh.vertices_xyz[:, 0].max() == pytest.approx(0.029)
    assert len(mesh.sigma) == len(mesh.normals) == len(mesh.vertices_xyz)


def test_other_side_of_a_thin_wall_is_kept():
    back = flat(z=-2e-4, flip=True)
    assert len(remove_redundant(back, flat(), max_distance=1e-3).faces) == len(back.faces)


def test_surface_beyond_the_maximum_distance_is_kept():
    apart = flat(z=1.2e-3)
    assert len(remove_redundant(apart, flat(), max_distance=1e-3).faces) == len(apart.faces)


def test_second_laser_adds_only_surface_that_the_first_did_not_measure():
    first = zipper_views(CELL, [sphere_view(0)], Poses.identity(1), EDGE)
    both = zipper_views(CELL, [sphere_view(0), sphere_view(1, 1)], Poses.identity(2), EDGE)
    second = zipper_views(CELL, [sphere_view(1)], Poses.identity(1), EDGE)
    assert area(first) < area(both) < area(first) + 0.35 * area(second)
    assert area(both) < 1.1 * 4.0 * np.pi * SPHERE.radius**2


def test_merged_mesh_is_oriented_and_has_unit_normals():
    mesh = zipper_views(CELL, [sphere_view(0), sphere_view(1, 1)], Poses.identity(2), EDGE)
    outward = (mesh.vertices_xyz - SPHERE.center) / SPHERE.radius
    assert np.abs(SPHERE.distance(mesh.vertices_xyz)).max() < 1e-12
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(len(mesh.normals)))
    assert ((mesh.normals * outward).sum(axis=1) > 0.9).all()
    middle = mesh.vertices_xyz[mesh.faces].mean(axis=1) - SPHERE.center
    assert ((normals.face_normals(mesh.vertices_xyz, mesh.faces) * middle).sum(axis=1) > 0).all()


def test_top_is_covered_once_though_it_is_crossed_twice():
    mesh = zipper_views(CELL, [sphere_view(0, steps=90)], Poses.identity(1), EDGE)
    corners = mesh.vertices_xyz[mesh.faces]
    # seen from above, as a share of a disc on the top of the sphere: the rest is the hole where
    # the stripe does not come nearer to the axis, and the rim that both sides keep
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radius = np.hypot(*(corners.mean(axis=1)[:, :2] - SPHERE.center[:2]).T)
    covered = 0.5 * across[radius < 0.012, 2].sum() / (np.pi * 0.012**2)
    assert 0.9 < covered < 1.15


def test_views_are_placed_by_their_poses():
    shift = transforms.rigid(np.eye(3), (0.0, 0.0, 0.08))
    poses = Poses(turntable_from_view=np.stack([np.eye(4), shift]))
    mesh = zipper_views(CELL, [sphere_view(), sphere_view(view=1)], poses, EDGE)
    upper = mesh.vertices_xyz[:, 2] > 0.07
    single = zipper_views(CELL, [sphere_view()], Poses.identity(1), EDGE)
    assert upper.sum() == (~upper).sum() == len(single.vertices_xyz)
    raised = Sphere(SPHERE.center + np.array([0.0, 0.0, 0.08]), SPHERE.radius)
    assert np.abs(raised.distance(mesh.vertices_xyz[upper])).max() < 1e-12


def test_empty_view_is_ignored():
    view = sphere_view()
    empty = without(view, np.ones(view.valid.shape, dtype=bool))
    mesh = zipper_views(CELL, [empty, view], Poses.identity(2), EDGE)
    assert len(mesh.faces) == len(zipper_views(CELL, [view], Poses.identity(1), EDGE).faces)


def test_points_too_far_apart_are_refused():
    with pytest.raises(GeometryError, match=r'meshing: .* within 0\.01 mm; raise max_edge'):
        zipper_views(CELL, [sphere_view()], Poses.identity(1), 1e-5)


def test_no_views_are_refused():
    with pytest.raises(GeometryError, match='meshing: no three neighboring points'):
        zipper_views(CELL, [], Poses.identity(0), EDGE)


def test_pose_that_is_missing_is_refused():
    with pytest.raises(ValueError, match='argument'):
        zipper_views(CELL, [sphere_view()], Poses.identity(2), EDGE)
