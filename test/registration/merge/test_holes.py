# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.registration.merge.holes import find_bores
from ivfmc_ros.registration.merge.line_segments import Strokes
from ivfmc_ros.registration.solver.surfels import Patches

EDGE, NOISE = 1.4e-3, 2.5e-5
CENTRES = np.array([[0.030, 0.010], [-0.010, 0.035]])
RADIUS = 0.0045


def face(normal=(0.0, 0.0, 1.0), count=500):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.05, 0.05, (count, 2)), np.full(count, 0.012)])
    return Patches(
        points_xyz=points,
        normals=np.tile(normal, (count, 1)),
        sigma=np.full(count, NOISE),
        sample=np.arange(count),
        members=np.zeros((count, 1), dtype=np.int64),
        weights=np.ones((count, 1)),
    )


def wall(centre, angles, seen_from_inside=True, seed=0):
    """Strokes down the wall of a hole, a few profiles 2 mm apart."""
    rng = np.random.default_rng(seed)
    angle, height = (one.ravel() for one in np.meshgrid(angles, np.linspace(0.007, 0.011, 9)))
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    points = np.append(centre, 0.0) + RADIUS * out + rng.normal(0.0, NOISE / 2, (len(out), 3))
    points[:, 2] = height
    sight = (-out if seen_from_inside else out) + (0.0, 0.0, 0.5)
    return Strokes(
        points_xyz=points,
        ways=np.tile([0.0, 0.0, 1.0], (len(points), 1)),
        sight=sight / np.linalg.norm(sight, axis=1, keepdims=True),
        sigma=NOISE,
    )


def both_walls(**how):
    walls = [wall(centre, np.radians([140, 165, 190, 215]), **how) for centre in CENTRES]
    return Strokes(
        points_xyz=np.concatenate([one.points_xyz for one in walls]),
        ways=np.concatenate([one.ways for one in walls]),
        sight=np.concatenate([one.sight for one in walls]),
        sigma=NOISE,
    )


def test_holes_are_found_where_a_few_profiles_show_a_part_of_their_walls():
    bores = find_bores(both_walls(), face(), EDGE)
    assert len(bores) == 2
    for bore, centre in zip(bores, CENTRES, strict=True):
        np.testing.assert_allclose(np.abs(bore.axis), (0.0, 0.0, 1.0), atol=1e-9)
        assert bore.radius == pytest.approx(RADIUS, abs=2e-4)
        # square to the middle of the arc
        assert bore.centre[1] == pytest.approx(centre[1], abs=3e-5)


def test_a_stud_is_no_hole():
    assert find_bores(both_walls(seen_from_inside=False), face(), EDGE) == ()


def test_a_hole_that_is_not_square_to_a_face_is_none():
    assert find_bores(both_walls(), face(normal=(1.0, 0.0, 0.0)), EDGE) == ()


def test_a_short_arc_says_too_little():
    strokes = wall(CENTRES[0], np.radians([170, 180, 190]))
    assert find_bores(strokes, face(), EDGE) == ()


def test_nothing_has_no_holes():
    assert find_bores(both_walls().chosen(np.arange(0)), face(), EDGE) == ()
