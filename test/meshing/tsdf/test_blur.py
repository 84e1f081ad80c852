# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy import ndimage

from ivfmc_ros.meshing.tsdf.blocks import BLOCK_SIDE
from ivfmc_ros.meshing.tsdf.blocks import BLOCK_VOXELS
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.blocks import VoxelGrid
from ivfmc_ros.meshing.tsdf.blur import SparseBlur

GRID = VoxelGrid(origin=np.zeros(3), voxel=1e-3, shape=(4, 3, 5))
KERNEL = np.array([0.1, 0.2, 0.4, 0.2, 0.1])


def dense(blocks, indices, values):
    """Return a dense array with values at flat indices, 0 elsewhere."""
    whole = np.zeros([side * BLOCK_SIDE for side in GRID.shape], dtype=np.float32)
    whole[tuple(blocks.voxels(indices).T)] = values
    return whole


@pytest.fixture(scope='module')
def scattered():
    """Return some blocks of the grid, flat indices in them, and three values at each."""
    rng = np.random.default_rng(0)
    blocks = VoxelBlocks(GRID, np.sort(rng.choice(60, 41, replace=False)))
    indices = np.sort(rng.choice(len(blocks) * BLOCK_VOXELS, 3000, replace=False))
    return blocks, indices, rng.normal(size=(3000, 3)).astype(np.float32)


@pytest.mark.parametrize('some', [slice(0, 41), slice(7, 8)])
def test_blur_crosses_the_borders_of_blocks(scattered, some):
    blocks, indices, values = scattered
    found = SparseBlur(blocks, indices).blur(some, values, KERNEL)
    own = np.arange(some.start * BLOCK_VOXELS, some.stop * BLOCK_VOXELS)
    for k in range(3):
        wanted = dense(blocks, indices, values[:, k])
        for axis in range(3):
            wanted = ndimage.correlate1d(wanted, KERNEL, axis=axis, mode='constant')
        assert found[:, k].ravel() == pytest.approx(wanted[tuple(blocks.voxels(own).T)], abs=1e-5)


def test_neighborhood_sums_are_over_27_voxels(scattered):
    blocks, indices, values = scattered
    queries = np.array(
        [-1, 513, 20, len(blocks) * BLOCK_VOXELS - 1, len(blocks) * BLOCK_VOXELS + 5, 513]
    )
    found = SparseBlur(blocks, indices).sum_neighborhoods(values, queries)
    sums = ndimage.correlate(
        dense(blocks, indices, values[:, 1]), np.ones((3, 3, 3)), mode='constant'
    )
    wanted = sums[tuple(blocks.voxels(queries[[1, 2, 3]]).T)]
    assert found[1:4, 1] == pytest.approx(wanted, abs=1e-5)
    assert (found[[0, 4]] == 0.0).all()
    assert (found[5] == found[1]).all()
