# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.orphan_points import attach_orphan_points
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples

VOXEL = 2e-4
SIGMA = 2e-5
UP = np.array([0.0, 0.0, 1.0])
RADIUS = 4e-3
NONE_DROPPED = np.empty((0, 3))


@pytest.fixture
def plane():
    rng = np.random.default_rng(1)
    places = rng.uniform(-3e-3, 3e-3, (800, 2))
    points = np.column_stack([places, rng.normal(scale=SIGMA, size=800)])
    up = np.tile(UP, (800, 1))
    return SurfaceSamples(
        points_xyz=points,
        normals=up,
        to_camera=up,
        weight=np.full(800, 1e9),
        intensity=np.full(800, 50.0),
        systematic=np.zeros(800),
    )


def test_point_in_the_plane_of_others_becomes_a_sample(plane):
    orphans = np.array([[1e-3, 0.0, 0.0]])
    found = attach_orphan_points(
        replace(plane, orphans_xyz=orphans), np.array([[0.0, 1e-3, 0.0]]), SIGMA, VOXEL, RADIUS
    )
    assert len(found) == 802
    assert not len(found.orphans_xyz)
    assert found.normals[-2:] @ UP == pytest.approx([1.0, 1.0], abs=0.01)
    assert (found.weight[-2:] < plane.weight[0]).all()


def test_orphan_off_the_plane_stays_one_and_a_truncated_end_is_dropped(plane):
    off = np.array([[1e-3, 0.0, 3e-4], [0.0, 9e-3, 0.0]])
    found = attach_orphan_points(
        replace(plane, orphans_xyz=off), off + np.array([1e-4, 0.0, 0.0]), SIGMA, VOXEL, RADIUS
    )
    assert len(found) == 800
    assert found.orphans_xyz == pytest.approx(off)


def test_points_along_a_line_give_no_normal(plane):
    places = np.arange(40)[:, None] * [5e-5, 0.0, 0.0] + [0.0, 9e-3, 0.0]
    found = attach_orphan_points(
        replace(plane, orphans_xyz=places), np.empty((0, 3)), SIGMA, VOXEL, RADIUS
    )
    assert len(found.orphans_xyz) == 40


def test_without_samples_no_point_is_attached(plane):
    names = [field.name for field in fields(plane) if field.name != 'orphans_xyz']
    none = SurfaceSamples(**{name: getattr(plane, name)[:0] for name in names})
    orphans = replace(none, orphans_xyz=np.zeros((3, 3)))
    assert attach_orphan_points(orphans, np.zeros((2, 3)), SIGMA, VOXEL, RADIUS) is orphans


def test_stripe_in_one_column_is_attached_to_the_face_beyond_a_gap(plane):
    run = np.arange(12)[:, None] * [0.0, 1.5e-4, 0.0] + [4.5e-3, 0.0, 0.0]
    found = attach_orphan_points(
        replace(plane, orphans_xyz=run), NONE_DROPPED, SIGMA, VOXEL, RADIUS
    )
    assert len(found) == 812
    assert np.abs(found.normals[-12:] @ UP).min() > 0.99


def test_stripe_beside_a_face_of_another_orientation_is_not_attached(plane):
    """The line and the edge of the face span a plane, but not that of the face."""
    run = np.arange(12)[:, None] * [0.0, 1.5e-4, 0.0] + [4.0e-3, 0.0, 1.0e-3]
    found = attach_orphan_points(
        replace(plane, orphans_xyz=run), NONE_DROPPED, SIGMA, VOXEL, RADIUS
    )
    assert len(found) == 800
    assert len(found.orphans_xyz) == 12
