# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.blocks import VoxelGrid

GRID = VoxelGrid(origin=np.zeros(3), voxel=1e-3, shape=(4, 3, 5))


def test_blocks_near_voxels_are_those_within_the_radius():
    rng = np.random.default_rng(1)
    high = np.array(GRID.shape) * BLOCK_SIDE - BLOCK_SIDE
    voxels = rng.integers(BLOCK_SIDE, high, size=(9, 3))
    found = VoxelBlocks.near(GRID, voxels, 2)
    whole = np.stack(np.indices([side * BLOCK_SIDE for side in GRID.shape]), axis=-1).reshape(
        -1, 3
    )
    near = (np.abs(whole[:, None] - voxels) <= 2).all(axis=2).any(axis=1)
    wanted = np.unique(whole[near] // BLOCK_SIDE, axis=0)
    assert (found.index == wanted).all()


def test_flat_indices_invert_voxels():
    blocks = VoxelBlocks(GRID, np.array([3, 7, 59]))
    indices = np.arange(len(blocks) * BLOCK_SIDE**3)
    assert (blocks.flat_indices(blocks.voxels(indices)) == indices).all()


def test_no_flat_index_without_a_block():
    blocks = VoxelBlocks(GRID, np.array([0]))
    voxels = np.array([[0, 0, 0], [7, 7, 8], [-1, 0, 0], [0, 24, 0], [32, 0, 0]])
    assert blocks.flat_indices(voxels).tolist() == [0, -1, -1, -1, -1]
