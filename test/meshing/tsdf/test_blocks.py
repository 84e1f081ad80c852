# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import Grid
from ivfmc_ros.meshing.tsdf.blocks import SIDE

GRID = Grid(origin=np.zeros(3), voxel=1e-3, shape=(4, 3, 5))


def test_blocks_near_voxels_are_those_within_the_radius():
    rng = np.random.default_rng(1)
    voxels = rng.integers(SIDE, np.array(GRID.shape) * SIDE - SIDE, size=(9, 3))
    found = Blocks.near(GRID, voxels, 2)
    whole = np.stack(np.indices([side * SIDE for side in GRID.shape]), axis=-1).reshape(-1, 3)
    near = (np.abs(whole[:, None] - voxels) <= 2).all(axis=2).any(axis=1)
    wanted = np.unique(whole[near] // SIDE, axis=0)
    assert (found.index == wanted).all()


def test_places_lead_back_to_their_voxels():
    blocks = Blocks(GRID, np.array([3, 7, 59]))
    places = np.arange(len(blocks) * SIDE**3)
    assert (blocks.place(blocks.voxels(places)) == places).all()


def test_no_place_where_no_block_is():
    blocks = Blocks(GRID, np.array([0]))
    voxels = np.array([[0, 0, 0], [7, 7, 8], [-1, 0, 0], [0, 24, 0], [32, 0, 0]])
    assert blocks.place(voxels).tolist() == [0, -1, -1, -1, -1]
