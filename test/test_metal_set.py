# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path-traced set: its halves share nothing, and its sensor and truth fit its cells."""

from dataclasses import replace

import numpy as np
import pytest

from bench.metal import parts
from bench.metal import pictures
from bench.metal.materials import grain_directions
from bench.metal.materials import MATERIALS
from bench.metal.pictures import DEVELOPMENT
from bench.metal.pictures import HELD
from bench.metal.pictures import Shot
from bench.metal.rigs import RIGS


def test_halves_share_no_part_rig_or_seed():
    for mine in DEVELOPMENT.pairs:
        for theirs in HELD.pairs:
            assert set(mine).isdisjoint(theirs)
    for material in MATERIALS:
        mine, theirs = (
            {shot.seed for shot in pictures.shots(half, material)} for half in (DEVELOPMENT, HELD)
        )
        assert mine.isdisjoint(theirs)


@pytest.mark.parametrize('name', ['flange', 'channel', 'gland', 'bracket'])
def test_parts_are_closed_and_fit_the_volume(name):
    solid = getattr(parts, name)()
    assert solid.watertight
    x, y, z = solid.vertices_xyz.T
    assert np.hypot(x, y).max() < 0.06
    assert z.min() == 0.0
    assert z.max() < 0.1


def test_name_of_a_picture_depends_on_what_it_shows():
    shot = Shot(material='brass', part='flange', rig='low', angle=0.1, laser=0, seed=1)
    others = [
        replace(shot, **change)
        for change in (
            {'material': 'ground steel'},
            {'part': 'channel'},
            {'rig': 'high'},
            {'angle': 0.2},
            {'laser': 1},
            {'seed': 2},
        )
    ]
    assert len({other.file for other in [shot, *others]}) == len(others) + 1
    assert replace(shot).file == shot.file


def test_stripe_is_seen_and_lit_from_where_the_lasers_stand():
    for rig in RIGS.values():
        for laser, source in zip(rig.cell.lasers, rig.sources, strict=True):
            assert abs(laser.distance(source.position[None])[0]) < 1e-9
    shot = Shot(material='brass', part='flange', rig='high', angle=0.4, laser=1, seed=1)
    truth = pictures.truth(shot)
    assert np.count_nonzero(truth.on_part) > 200


def test_marks_of_grinding_lie_in_the_face():
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8]])
    along = grain_directions(normals)
    np.testing.assert_allclose((along * normals).sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0)
