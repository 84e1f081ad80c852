# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the camera looked through is outside, whatever the planes of the samples beside it say.

Over a sharp edge, the plane of one face goes on into the air; the rays to the other face go
through there.
"""

import numpy as np

from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.meshing.tsdf.blocks import Blocks
from ivfmc_ros.model import Singles

_STEPS = 9
_STEP = 0.9  # voxels
# A ray begins so many voxels above its sample's plane: below, it says nothing.
_CLEARANCE = 1.0
_RAYS = 2  # that have to agree
# Rays to steeper surfaces run along them.
_LEAST_FACING = 0.15
_OUTSIDE = 0.3  # voxels


def carve(blocks: Blocks, values: Singles, samples: Samples) -> None:
    """Make voxels that rays go through outside; ``values`` (blocks, 8, 8, 8) are changed."""
    facing = (samples.normals * samples.sight).sum(axis=1)
    chosen = np.flatnonzero(facing > _LEAST_FACING)[::2]
    start = _CLEARANCE / facing[chosen, None]
    at = blocks.grid.coordinates(samples.points_xyz[chosen])
    sight = samples.sight[chosen]
    at = (at + start * sight + 0.5).astype(np.float32)
    step = (_STEP * sight).astype(np.float32)
    flat = values.reshape(-1)
    inside = flat < 0
    rays = np.zeros(flat.size, dtype=np.uint8)
    for _ in range(_STEPS):
        place = blocks.place(at.astype(np.int64))
        hit = place[(place >= 0) & inside[place]]
        rays[hit] = np.minimum(rays[hit] + 1, 200)
        at += step
    flat[rays >= _RAYS] = _OUTSIDE
