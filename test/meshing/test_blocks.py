# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy import ndimage

from ivfmc_ros.meshing.blocks import Blocks
from ivfmc_ros.meshing.blocks import Grid
from ivfmc_ros.meshing.blocks import SIDE

GRID = Grid(origin=np.zeros(3), voxel=1e-3, shape=(4, 3, 5))
KERNEL = np.array([0.1, 0.2, 0.4, 0.2, 0.1])


def dense(blocks, values):
    """Blocks of values in one array; 0 where there is no block."""
    whole = np.zeros([side * SIDE for side in GRID.shape], dtype=np.float32)
    for (i, j, k), block in zip(SIDE * blocks.index, values, strict=True):
        whole[i : i + SIDE, j : j + SIDE, k : k + SIDE] = block
    return whole


@pytest.mark.parametrize('shape', [(), (3,)])
def test_blur_goes_over_the_borders_of_blocks(shape):
    rng = np.random.default_rng(0)
    ids = np.sort(rng.choice(60, 41, replace=False))
    blocks = Blocks(GRID, ids)
    values = rng.normal(size=(41, SIDE, SIDE, SIDE, *shape)).astype(np.float32)
    found = blocks.blurred(values, KERNEL)
    assert found.shape == values.shape
    for k in range(max(1, sum(shape))):
        one, own = (array[..., k] if shape else array for array in (values, found))
        wanted = dense(blocks, one)
        for axis in (2, 1, 0):
            wanted = ndimage.correlate1d(wanted, KERNEL, axis=axis, mode='constant')
            # between the passes too, only blocks have values
            wanted *= dense(blocks, np.ones_like(one))
        assert dense(blocks, own) == pytest.approx(wanted, abs=1e-5)
