# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Space carving: voxels on the lines of sight of measured points become outside.

Over a sharp edge the plane of one face extends into the air, where the signed distance to it says
inside. The lines of sight to the other face pass there and show that it is empty.
"""

import numpy as np

from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.model import Singles

_STEPS = 9  # along each ray
_STEP = 0.9  # voxels
# A ray begins at this height over the plane of its sample (voxels): nearer, the noise of the
# sample decides on which side a voxel is.
_CLEARANCE = 1.0
_MIN_RAYS = 2  # through a voxel, so that one outlier carves nothing
# Least cosine between ray and normal: rays at grazing incidence run along the surface.
_MIN_FACING = 0.15
_OUTSIDE = 0.3  # voxels, the distance given to carved voxels


def carve_free_space(blocks: VoxelBlocks, values: Singles, samples: SurfaceSamples) -> None:
    """
    Set inside voxels that rays of samples pass through to outside, in place.

    values : (blocks, 8, 8, 8) float32, signed distance in voxels, positive outside
    """
    facing = (samples.normals * samples.to_camera).sum(axis=1)
    chosen = np.flatnonzero(facing > _MIN_FACING)[::2]
    start = _CLEARANCE / facing[chosen, None]
    at = blocks.grid.to_voxels(samples.points_xyz[chosen])
    to_camera = samples.to_camera[chosen]
    at = (at + start * to_camera + 0.5).astype(np.float32)
    step = (_STEP * to_camera).astype(np.float32)
    flat = values.reshape(-1)
    inside = flat < 0
    rays = np.zeros(flat.size, dtype=np.uint8)
    for _ in range(_STEPS):
        index = blocks.flat_indices(at.astype(np.int64))
        hit = index[(index >= 0) & inside[index]]
        rays[hit] = np.minimum(rays[hit] + 1, 200)
        at += step
    flat[rays >= _MIN_RAYS] = _OUTSIDE
