# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import trimesh

from ivfmc_ros.meshing.tsdf.blocks import VoxelBlocks
from ivfmc_ros.meshing.tsdf.blocks import VoxelGrid
from ivfmc_ros.meshing.tsdf.surface_nets import extract_surface


def whole(shape=(3, 3, 3)):
    grid = VoxelGrid(origin=np.zeros(3), voxel=1e-3, shape=shape)
    return VoxelBlocks(grid, np.arange(int(np.prod(shape))))


def values_of(blocks, dense):
    index = blocks.voxels(np.arange(len(blocks) * 512))
    return dense[tuple(index.T)].reshape(-1, 8, 8, 8).astype(np.float32)


def bordered(dense):
    """Return values that are far outside near the border of the grid."""
    return np.pad(dense[6:-6, 6:-6, 6:-6], 6, constant_values=9.0)


def as_trimesh(surface):
    quads = surface.quads
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return trimesh.Trimesh(surface.vertices, faces, process=False)


def test_ball_is_closed_and_faces_outward():
    blocks = whole()
    at = np.stack(np.indices((24, 24, 24)), axis=3) - 11.3
    mesh = as_trimesh(extract_surface(blocks, values_of(blocks, np.linalg.norm(at, axis=3) - 7.0)))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 7**3, rel=0.03)
    assert np.linalg.norm(mesh.vertices - 11.3, axis=1) == pytest.approx(7.0, abs=0.2)
    assert mesh.euler_number == 2


@pytest.mark.parametrize('seed', range(8))
def test_noise_makes_a_closed_manifold(seed):
    blocks = whole()
    dense = np.random.default_rng(seed).normal(size=(24, 24, 24))
    dense = bordered(dense)
    surface = extract_surface(blocks, values_of(blocks, dense))
    mesh = as_trimesh(surface)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    edges = np.sort(
        np.stack([surface.quads, np.roll(surface.quads, 1, axis=1)], 2).reshape(-1, 2), 1
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_vertices_stay_in_their_cells():
    blocks = whole()
    dense = np.random.default_rng(9).normal(size=(24, 24, 24))
    dense = bordered(dense)
    surface = extract_surface(blocks, values_of(blocks, dense))
    inside = surface.vertices - surface.cells
    assert inside.min() >= 0.0
    assert inside.max() <= 1.0


def test_cell_that_begins_in_a_missing_block_is_added():
    blocks = whole()
    at = np.stack(np.indices((24, 24, 24)), axis=3) - 11.3
    values = values_of(blocks, np.linalg.norm(at, axis=3) - 5.8)
    complete = extract_surface(blocks, values)
    assert (complete.cells == 7).all(axis=1).any()
    # of the first block the surface needs only its last voxel's corner, in that very cell
    without = extract_surface(VoxelBlocks(blocks.grid, np.arange(1, 27)), values[1:])
    assert as_trimesh(without).is_watertight
    by_cell = [surface.vertices[np.lexsort(surface.cells.T)] for surface in (complete, without)]
    assert np.array_equal(*by_cell)
