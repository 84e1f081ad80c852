# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.registration.merge.holes import find_holes
from ivfmc_ros.registration.merge.line_segments import LineSegments
from ivfmc_ros.registration.solver.surfels import Surfels

EDGE, NOISE = 1.4e-3, 2.5e-5
CENTERS = np.array([[0.030, 0.010], [-0.010, 0.035]])
RADIUS = 0.0045


def face(normal=(0.0, 0.0, 1.0), count=500):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.05, 0.05, (count, 2)), np.full(count, 0.012)])
    return Surfels(
        points_xyz=points,
        normals=np.tile(normal, (count, 1)),
        sigma=np.full(count, NOISE),
        sample=np.arange(count),
        members=np.zeros((count, 1), dtype=np.int64),
        weights=np.ones((count, 1)),
    )


def wall(center, angles, seen_from_inside=True, seed=0):
    """Line segments down the wall of a hole, a few profiles 2 mm apart."""
    rng = np.random.default_rng(seed)
    angle, height = (one.ravel() for one in np.meshgrid(angles, np.linspace(0.007, 0.011, 9)))
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    points = np.append(center, 0.0) + RADIUS * out + rng.normal(0.0, NOISE / 2, (len(out), 3))
    points[:, 2] = height
    sight = (-out if seen_from_inside else out) + (0.0, 0.0, 0.5)
    return LineSegments(
        points_xyz=points,
        directions=np.tile([0.0, 0.0, 1.0], (len(points), 1)),
        sight=sight / np.linalg.norm(sight, axis=1, keepdims=True),
        sigma=NOISE,
    )


def both_walls(**how):
    walls = [wall(center, np.radians([140, 165, 190, 215]), **how) for center in CENTERS]
    return LineSegments(
        points_xyz=np.concatenate([one.points_xyz for one in walls]),
        directions=np.concatenate([one.directions for one in walls]),
        sight=np.concatenate([one.sight for one in walls]),
        sigma=NOISE,
    )


def test_holes_are_found_where_a_few_profiles_show_a_part_of_their_walls():
    holes = find_holes(both_walls(), face(), EDGE)
    assert len(holes) == 2
    for hole, center in zip(holes, CENTERS, strict=True):
        np.testing.assert_allclose(np.abs(hole.axis), (0.0, 0.0, 1.0), atol=1e-9)
        assert hole.radius == pytest.approx(RADIUS, abs=2e-4)
        # square to the middle of the arc
        assert hole.center[1] == pytest.approx(center[1], abs=3e-5)


def test_stud_is_not_taken_for_a_hole():
    assert find_holes(both_walls(seen_from_inside=False), face(), EDGE) == ()


def test_hole_that_is_not_square_to_a_face_is_not_found():
    assert find_holes(both_walls(), face(normal=(1.0, 0.0, 0.0)), EDGE) == ()


def test_short_arc_is_not_taken_for_a_hole():
    segments = wall(CENTERS[0], np.radians([170, 180, 190]))
    assert find_holes(segments, face(), EDGE) == ()


def test_no_segments_give_no_holes():
    assert find_holes(both_walls().selected(np.arange(0)), face(), EDGE) == ()
