# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.hole_alignment import meetings_along
from ivfmc_ros.registration.merge.hole_alignment import moved_along
from ivfmc_ros.registration.merge.hole_alignment import seat
from ivfmc_ros.registration.merge.hole_alignment import telling
from ivfmc_ros.registration.merge.holes import Bore

CIRCLE, RADIUS, NOISE = 0.040, 0.0045, 2.5e-5
UP = np.array([0.0, 0.0, 1.0])
# a metre at the bolt circle
TURN = np.array([0.0, 0.0, 1.0 / CIRCLE, 0.0, 0.0, 0.0])


def hole(azimuth, arc, seed=0, axis=UP, radius=RADIUS, circle=CIRCLE):
    """A hole on a bolt circle whose wall is seen between two angles, degrees."""
    rng = np.random.default_rng(seed)
    centre = circle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    angle = np.radians(np.linspace(*arc, 40))
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    distance = radius + rng.normal(0.0, NOISE, 40)
    points = centre + distance[:, None] * out + rng.uniform(0.0, 0.01, 40)[:, None] * axis
    return Bore(points_xyz=points, axis=axis, centre=centre, radius=radius, sigma=NOISE)


def holes(azimuths, arc, seed=0):
    return [hole(np.radians(a), arc, seed + k) for k, a in enumerate(azimuths)]


def turned(bores, degrees):
    T = transforms.rigid(transforms.rotation_z(np.radians(degrees)), np.zeros(3))
    return [bore.moved(T) for bore in bores]


def test_holes_of_which_each_scan_shows_another_side_hold_the_turn():
    onto = holes((0, 60, 180, 300), (100, 250))
    body = turned(holes((0, 60, 180, 300), (10, 170), seed=10), 0.8)
    found = seat(body, onto, TURN, 2e-3)
    assert found.holes == 4
    # 0.02 degrees
    assert found.amount == pytest.approx(-np.radians(0.8) * CIRCLE, abs=1.5e-5)
    assert found.sigma < 2e-5


def test_two_holes_in_their_places_may_be_chance():
    onto = holes((0, 60), (100, 250))
    assert seat(onto, onto, TURN, 2e-3) is None


def test_holes_that_do_not_fit_together_hold_nothing():
    onto = holes((0, 60, 180), (0, 300))
    # each is off its place in another way
    body = [turned([one], off)[0] for one, off in zip(onto, (1.5, -1.5, 1.0), strict=True)]
    assert seat(body, onto, TURN, 2e-3) is None


def test_every_turn_that_brings_a_bolt_circle_into_itself_is_found():
    onto = holes(range(0, 360, 60), (100, 250))
    steps = np.linspace(0.0, 2.0 * np.pi, 721)[:-1] * CIRCLE
    path = np.array([moved_along(TURN, t) for t in steps])
    found = np.degrees(steps[meetings_along(onto, onto, path, 1.5e-3)] / CIRCLE)
    near = np.unique(np.round(found / 60.0)) % 6
    np.testing.assert_allclose(found, 60.0 * np.round(found / 60.0), atol=0.5)
    assert sorted(set(near)) == [0, 1, 2, 3, 4, 5]


def test_a_turn_at_which_one_hole_meets_is_found_too():
    onto, body = holes((0, 60, 180), (100, 250)), holes((0, 60, 120), (100, 250))
    steps = np.linspace(0.0, 2.0 * np.pi, 721)[:-1] * CIRCLE
    path = np.array([moved_along(TURN, t) for t in steps])
    found = np.degrees(steps[meetings_along(body, onto, path, 1.5e-3)] / CIRCLE)
    np.testing.assert_allclose(np.sort(found % 359.0), (0, 60, 120, 180, 240, 300), atol=0.6)


def test_holes_of_another_size_or_direction_do_not_meet():
    onto = holes((0, 60, 180, 300), (100, 250))
    path = np.eye(4)[None]
    assert len(meetings_along(onto, onto, path, 1e-3)) == 1
    wider = [replace(bore, radius=1.3 * bore.radius) for bore in onto]
    aslant = [replace(bore, axis=np.array([0.0, 0.6, 0.8])) for bore in onto]
    assert not len(meetings_along(wider, onto, path, 1e-3))
    assert not len(meetings_along(aslant, onto, path, 1e-3))
    assert not len(meetings_along([], onto, path, 1e-3))


def test_a_hole_on_the_axis_tells_nothing_of_a_turn():
    off, on = holes((0,), (0, 300))[0], hole(0.0, (0, 300), circle=0.0)
    assert telling([off, on], TURN) == [off]


def test_following_a_screw_moves_along_its_axis_too():
    screw = np.array([0.0, 0.0, 2.0, 0.0, -2.0 * 0.01, 0.3])
    T = moved_along(screw, 0.5)
    # about the axis through (0.01, 0, 0)
    np.testing.assert_allclose(
        transforms.apply(T, np.array([[0.01, 0.0, 0.0]])), [[0.01, 0.0, 0.15]], atol=1e-12
    )
    np.testing.assert_allclose(T[:3, :3], transforms.rotation_z(1.0), atol=1e-12)
    shift = moved_along(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 0.2)
    np.testing.assert_allclose(shift[:3, 3], (0.2, 0.0, 0.0))
