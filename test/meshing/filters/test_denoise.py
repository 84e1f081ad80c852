# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.filters.denoise import unfold


@pytest.fixture
def sheet():
    """A flat 6 x 6 grid of quads that face +z."""
    row, column = (index.ravel() for index in np.indices((6, 6)))
    vertices = np.stack([row, column, 0 * row], axis=1).astype(np.float64)
    place = np.arange(36).reshape(6, 6)
    quads = np.stack([place[:-1, :-1], place[1:, :-1], place[1:, 1:], place[:-1, 1:]], axis=-1)
    return vertices, quads.reshape(-1, 4)


def test_vertex_that_folds_a_quad_is_put_back(sheet):
    vertices, quads = sheet
    moved = vertices.copy()
    moved[14] += [1.6, 0.0, 0.1]
    assert np.array_equal(unfold(vertices, moved, quads), vertices)


def test_vertices_that_fold_no_quad_stay_moved(sheet):
    vertices, quads = sheet
    moved = vertices + np.random.default_rng(0).uniform(-0.2, 0.2, vertices.shape)
    assert np.array_equal(unfold(vertices, moved, quads), moved)
