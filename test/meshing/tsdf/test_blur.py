# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy import ndimage

from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.meshing.tsdf.blocks import Grid
from ivfmc_ros.meshing.tsdf.blocks import SIDE
from ivfmc_ros.meshing.tsdf.blocks import VOLUME
from ivfmc_ros.meshing.tsdf.blur import Spread

GRID = Grid(origin=np.zeros(3), voxel=1e-3, shape=(4, 3, 5))
KERNEL = np.array([0.1, 0.2, 0.4, 0.2, 0.1])


def dense(blocks, places, values):
    """Values at places in one array; 0 elsewhere."""
    whole = np.zeros([side * SIDE for side in GRID.shape], dtype=np.float32)
    whole[tuple(blocks.voxels(places).T)] = values
    return whole


@pytest.fixture(scope='module')
def scattered():
    """Some blocks of the grid, places in them, and three values at each of these."""
    rng = np.random.default_rng(0)
    blocks = Blocks(GRID, np.sort(rng.choice(60, 41, replace=False)))
    places = np.sort(rng.choice(len(blocks) * VOLUME, 3000, replace=False))
    return blocks, places, rng.normal(size=(3000, 3)).astype(np.float32)


@pytest.mark.parametrize('some', [slice(0, 41), slice(7, 8)])
def test_blur_goes_over_the_borders_of_blocks(scattered, some):
    blocks, places, values = scattered
    found = Spread(blocks, places).blurred(some, values, KERNEL)
    own = np.arange(some.start * VOLUME, some.stop * VOLUME)
    for k in range(3):
        wanted = dense(blocks, places, values[:, k])
        for axis in range(3):
            wanted = ndimage.correlate1d(wanted, KERNEL, axis=axis, mode='constant')
        assert found[:, k].ravel() == pytest.approx(wanted[tuple(blocks.voxels(own).T)], abs=1e-5)


def test_around_sums_27_voxels_and_nothing_elsewhere(scattered):
    blocks, places, values = scattered
    asked = np.array([-1, 513, 20, len(blocks) * VOLUME - 1, len(blocks) * VOLUME + 5, 513])
    found = Spread(blocks, places).around(values, asked)
    sums = ndimage.correlate(
        dense(blocks, places, values[:, 1]), np.ones((3, 3, 3)), mode='constant'
    )
    wanted = sums[tuple(blocks.voxels(asked[[1, 2, 3]]).T)]
    assert found[1:4, 1] == pytest.approx(wanted, abs=1e-5)
    assert (found[[0, 4]] == 0.0).all()
    assert (found[5] == found[1]).all()
