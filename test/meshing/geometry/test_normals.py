# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import warnings

import numpy as np
import pytest

from ivfmc_ros.meshing.geometry import normals

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_counter_clockwise_is_outward():
    assert normals.face_normals(SQUARE, FACES).tolist() == [[0, 0, 1], [0, 0, 1]]
    assert normals.vertex_normals(SQUARE, FACES).tolist() == [[0, 0, 1]] * 4
    assert normals.face_normals(SQUARE, FACES[:, ::-1]).tolist() == [[0, 0, -1], [0, 0, -1]]


def test_larger_faces_weigh_more():
    # a floor of area 3/2 and a wall of area 1/2 at the edge from 0 to 1
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 3, 0], [0, 0, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    assert normals.vertex_normals(points, faces)[0] == pytest.approx(np.array([0, 1, 3]) / 10**0.5)


def test_face_without_area_has_no_normal():
    points = np.vstack([SQUARE, [[0.5, 0.5, 0.0], [9.0, 9.0, 9.0]]])
    faces = np.array([[0, 2, 4]])
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert np.isnan(normals.face_normals(points, faces)).all()
        assert np.isnan(normals.vertex_normals(points, faces)).all()


def test_no_faces_no_normals():
    none = np.empty((0, 3), dtype=np.int64)
    assert normals.face_normals(SQUARE, none).shape == (0, 3)
    assert np.isnan(normals.vertex_normals(SQUARE, none)).all()
