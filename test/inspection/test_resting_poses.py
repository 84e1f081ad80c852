# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.resting_poses import resting_poses
from ivfmc_ros.inspection.resting_poses import volume_centroid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import sphere
from ivfmc_ros.simulation.parts.solids import stepped_shaft


def body(solid):
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=solid.faces, closed=True)


def test_box_rests_on_each_of_its_faces():
    poses = resting_poses(body(box((0.02, 0.03, 0.05))))
    assert [pose.area for pose in poses] == pytest.approx([15e-4] * 2 + [10e-4] * 2 + [6e-4] * 2)
    for pose in poses:
        placed = transforms.apply(pose.table_from_part, box((0.02, 0.03, 0.05)).vertices_xyz)
        assert placed[:, 2].min() == pytest.approx(0.0, abs=1e-12)
        assert placed[:, :2].mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)
        assert transforms.is_rotation(pose.table_from_part[:3, :3])


def test_shaft_stands_on_its_ends_and_not_on_its_round_side():
    poses = resting_poses(body(stepped_shaft([(0.02, 0.015), (0.01, 0.02)])))
    assert [round(float(pose.down[2])) for pose in poses] == [-1, 1]


def test_part_does_not_rest_on_a_flat_beside_its_centroid():
    # a slanted column: its upper end reaches 60 mm beyond its foot of 20 mm
    solid = box((0.02, 0.02, 0.06))
    sheared = solid.vertices_xyz + solid.vertices_xyz[:, 2:] * (1.0, 0.0, 0.0)
    poses = resting_poses(MeshBody(vertices_xyz=sheared, faces=solid.faces, closed=True))
    assert poses
    assert all(abs(pose.down[2]) < 0.9 for pose in poses)


def test_ball_rests_on_nothing():
    assert resting_poses(body(sphere(0.02))) == []


def test_centroid_is_that_of_the_volume():
    # the thick half of the shaft weighs four times as much
    solid = stepped_shaft([(0.02, 0.02), (0.01, 0.02)])
    centroid = volume_centroid(solid.vertices_xyz, solid.faces)
    assert centroid == pytest.approx([0.0, 0.0, (4 * 0.01 + 0.03) / 5], abs=1e-6)


def test_sheet_without_volume_has_no_pose():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    assert resting_poses(MeshBody(vertices_xyz=flat, faces=faces, closed=False)) == []
