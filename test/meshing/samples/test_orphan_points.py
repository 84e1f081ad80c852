# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.meshing.samples.orphan_points import adopted
from ivfmc_ros.meshing.samples.surface_samples import Samples

VOXEL = 2e-4
SIGMA = 2e-5
UP = np.array([0.0, 0.0, 1.0])
REACH = 4e-3
NO_CUTS = np.empty((0, 3))


@pytest.fixture
def plane():
    rng = np.random.default_rng(1)
    places = rng.uniform(-3e-3, 3e-3, (800, 2))
    points = np.column_stack([places, rng.normal(scale=SIGMA, size=800)])
    up = np.tile(UP, (800, 1))
    return Samples(
        points_xyz=points,
        normals=up,
        sight=up,
        weight=np.full(800, 1e9),
        intensity=np.full(800, 50.0),
    )


def test_point_in_the_plane_of_others_becomes_a_sample(plane):
    alone = np.array([[1e-3, 0.0, 0.0]])
    found = adopted(
        replace(plane, alone_xyz=alone), np.array([[0.0, 1e-3, 0.0]]), SIGMA, VOXEL, REACH
    )
    assert len(found) == 802
    assert not len(found.alone_xyz)
    assert found.normals[-2:] @ UP == pytest.approx([1.0, 1.0], abs=0.01)
    assert (found.weight[-2:] < plane.weight[0]).all()


def test_point_off_the_plane_stays_alone_and_a_cut_end_is_given_up(plane):
    off = np.array([[1e-3, 0.0, 3e-4], [0.0, 9e-3, 0.0]])
    found = adopted(
        replace(plane, alone_xyz=off), off + np.array([1e-4, 0.0, 0.0]), SIGMA, VOXEL, REACH
    )
    assert len(found) == 800
    assert found.alone_xyz == pytest.approx(off)


def test_points_along_a_line_give_no_normal(plane):
    places = np.arange(40)[:, None] * [5e-5, 0.0, 0.0] + [0.0, 9e-3, 0.0]
    found = adopted(replace(plane, alone_xyz=places), np.empty((0, 3)), SIGMA, VOXEL, REACH)
    assert len(found.alone_xyz) == 40


def test_without_samples_nothing_is_adopted(plane):
    none = Samples(**{name: getattr(plane, name)[:0] for name in
                      ('points_xyz', 'normals', 'sight', 'weight', 'intensity')})  # fmt: skip
    alone = replace(none, alone_xyz=np.zeros((3, 3)))
    assert adopted(alone, np.zeros((2, 3)), SIGMA, VOXEL, REACH) is alone


def test_stripe_in_one_column_is_part_of_the_face_that_goes_on_behind_a_gap(plane):
    run = np.arange(12)[:, None] * [0.0, 1.5e-4, 0.0] + [4.5e-3, 0.0, 0.0]
    found = adopted(replace(plane, alone_xyz=run), NO_CUTS, SIGMA, VOXEL, REACH)
    assert len(found) == 812
    assert np.abs(found.normals[-12:] @ UP).min() > 0.99


def test_stripe_beside_a_face_that_looks_elsewhere_is_not_part_of_it(plane):
    """A line and the edge of a face make a plane, but it is not that face's."""
    run = np.arange(12)[:, None] * [0.0, 1.5e-4, 0.0] + [4.0e-3, 0.0, 1.0e-3]
    found = adopted(replace(plane, alone_xyz=run), NO_CUTS, SIGMA, VOXEL, REACH)
    assert len(found) == 800
    assert len(found.alone_xyz) == 12
