# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.free_motion import constraining_poses
from ivfmc_ros.registration.merge.free_motion import sample_motion
from ivfmc_ros.registration.solver.surfels import Surfels

EDGE = 1e-3
TURN = np.array([0.0, 0.0, 30.0, 0.0, 0.0, 0.0])


def shaft(key):
    """A shaft about z, with or without the walls of a keyway at azimuth 0."""
    azimuth, height = np.meshgrid(np.arange(0, 2 * np.pi, 0.06), np.arange(0, 0.03, EDGE))
    normals = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=2).reshape(-1, 3)
    points = 0.016 * normals + np.outer(height.ravel(), (0, 0, 1))
    if key:
        depth, height = np.meshgrid(np.arange(0.01, 0.016, EDGE), np.arange(0, 0.03, EDGE))
        for side in (-1.0, 1.0):
            wall = np.stack([depth, 0 * depth + side * 0.004, height], axis=2).reshape(-1, 3)
            points = np.concatenate([points, wall])
            normals = np.concatenate([normals, np.tile([0.0, -side, 0.0], (len(wall), 1))])
    none = np.zeros((len(points), 1))
    surfels = Surfels(
        points_xyz=points,
        normals=normals,
        sigma=none[:, 0] + 1e-5,
        sample=np.arange(len(points)),
        members=none.astype(np.int64),
        weights=none,
    )
    return ClampedSurface(name='shaft', surfels=surfels, sight=normals)


def turned(surface, degrees):
    return surface.transformed(
        transforms.rigid(transforms.rotation_z(np.radians(degrees)), np.zeros(3))
    )


def test_keyways_of_two_scans_constrain_the_turn():
    found = constraining_poses(turned(shaft(key=True), 77.0), shaft(key=True), TURN, EDGE)
    angles = np.degrees(np.arctan2(found[:, 1, 0], found[:, 0, 0]))
    assert angles[0] == pytest.approx(-77.0, abs=2.0)


@pytest.mark.parametrize('keys', [(False, False), (True, False), (False, True)])
def test_turn_stays_free_where_one_of_the_two_is_round(keys):
    assert not len(constraining_poses(shaft(key=keys[0]), shaft(key=keys[1]), TURN, EDGE))


def test_rotation_is_sampled_over_a_turn_and_translation_in_both_directions():
    path = sample_motion(TURN, shaft(key=False), 2e-3)
    np.testing.assert_allclose(path[0], np.eye(4), atol=1e-12)
    assert len(path) == pytest.approx(2 * np.pi / 30.0 / 2e-3, abs=1)
    way = sample_motion(np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), shaft(key=False), 2e-3)[:, 1, 3]
    assert way.min() < -0.04
    assert way.max() > 0.04
