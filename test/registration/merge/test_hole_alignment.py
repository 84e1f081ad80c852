# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.hole_alignment import align_holes
from ivfmc_ros.registration.merge.hole_alignment import constraining_holes
from ivfmc_ros.registration.merge.hole_alignment import matching_poses
from ivfmc_ros.registration.merge.hole_alignment import motion_transform
from ivfmc_ros.registration.merge.holes import Hole

CIRCLE, RADIUS, NOISE = 0.040, 0.0045, 2.5e-5
UP = np.array([0.0, 0.0, 1.0])
# displaces a point of the bolt circle by one meter
TURN = np.array([0.0, 0.0, 1.0 / CIRCLE, 0.0, 0.0, 0.0])


def hole(azimuth, arc, seed=0, axis=UP, radius=RADIUS, circle=CIRCLE):
    """A hole on a bolt circle whose wall is seen between two angles, degrees."""
    rng = np.random.default_rng(seed)
    center = circle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    angle = np.radians(np.linspace(*arc, 40))
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    distance = radius + rng.normal(0.0, NOISE, 40)
    points = center + distance[:, None] * out + rng.uniform(0.0, 0.01, 40)[:, None] * axis
    return Hole(points_xyz=points, axis=axis, center=center, radius=radius, sigma=NOISE)


def bolt_circle(azimuths, arc, seed=0):
    return [hole(np.radians(a), arc, seed + k) for k, a in enumerate(azimuths)]


def turned(holes, degrees):
    T = transforms.rigid(transforms.rotation_z(np.radians(degrees)), np.zeros(3))
    return [hole.transformed(T) for hole in holes]


def test_turn_is_found_from_holes_of_which_each_scan_shows_another_side():
    onto = bolt_circle((0, 60, 180, 300), (100, 250))
    body = turned(bolt_circle((0, 60, 180, 300), (10, 170), seed=10), 0.8)
    found = align_holes(body, onto, TURN, 2e-3)
    assert found.holes == 4
    # 0.02 degrees
    assert found.amount == pytest.approx(-np.radians(0.8) * CIRCLE, abs=1.5e-5)
    assert found.sigma < 2e-5


def test_two_holes_are_too_few():
    onto = bolt_circle((0, 60), (100, 250))
    assert align_holes(onto, onto, TURN, 2e-3) is None


def test_holes_that_do_not_fit_together_give_no_amount():
    onto = bolt_circle((0, 60, 180), (0, 300))
    # each is off its place in another way
    body = [turned([one], off)[0] for one, off in zip(onto, (1.5, -1.5, 1.0), strict=True)]
    assert align_holes(body, onto, TURN, 2e-3) is None


def test_every_turn_that_brings_a_bolt_circle_into_itself_is_found():
    onto = bolt_circle(range(0, 360, 60), (100, 250))
    steps = np.linspace(0.0, 2.0 * np.pi, 721)[:-1] * CIRCLE
    path = np.array([motion_transform(TURN, t) for t in steps])
    found = np.degrees(steps[matching_poses(onto, onto, path, 1.5e-3)] / CIRCLE)
    near = np.unique(np.round(found / 60.0)) % 6
    np.testing.assert_allclose(found, 60.0 * np.round(found / 60.0), atol=0.5)
    assert sorted(set(near)) == [0, 1, 2, 3, 4, 5]


def test_turn_at_which_one_hole_corresponds_is_found_too():
    onto, body = bolt_circle((0, 60, 180), (100, 250)), bolt_circle((0, 60, 120), (100, 250))
    steps = np.linspace(0.0, 2.0 * np.pi, 721)[:-1] * CIRCLE
    path = np.array([motion_transform(TURN, t) for t in steps])
    found = np.degrees(steps[matching_poses(body, onto, path, 1.5e-3)] / CIRCLE)
    np.testing.assert_allclose(np.sort(found % 359.0), (0, 60, 120, 180, 240, 300), atol=0.6)


def test_holes_of_another_size_or_direction_do_not_correspond():
    onto = bolt_circle((0, 60, 180, 300), (100, 250))
    path = np.eye(4)[None]
    assert len(matching_poses(onto, onto, path, 1e-3)) == 1
    wider = [replace(hole, radius=1.3 * hole.radius) for hole in onto]
    aslant = [replace(hole, axis=np.array([0.0, 0.6, 0.8])) for hole in onto]
    assert not len(matching_poses(wider, onto, path, 1e-3))
    assert not len(matching_poses(aslant, onto, path, 1e-3))
    assert not len(matching_poses([], onto, path, 1e-3))


def test_hole_on_the_axis_does_not_constrain_a_turn():
    off, on = bolt_circle((0,), (0, 300))[0], hole(0.0, (0, 300), circle=0.0)
    assert constraining_holes([off, on], TURN) == [off]


def test_screw_motion_moves_along_its_axis_too():
    screw = np.array([0.0, 0.0, 2.0, 0.0, -2.0 * 0.01, 0.3])
    T = motion_transform(screw, 0.5)
    # about the axis through (0.01, 0, 0)
    np.testing.assert_allclose(
        transforms.apply(T, np.array([[0.01, 0.0, 0.0]])), [[0.01, 0.0, 0.15]], atol=1e-12
    )
    np.testing.assert_allclose(T[:3, :3], transforms.rotation_z(1.0), atol=1e-12)
    shift = motion_transform(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 0.2)
    np.testing.assert_allclose(shift[:3, 3], (0.2, 0.0, 0.0))
