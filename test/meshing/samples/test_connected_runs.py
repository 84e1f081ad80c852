# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.meshing.samples.connected_runs import ConnectedRuns


def test_runs_end_where_the_next_point_is_not_connected():
    right = np.array([[True, True, False, True, False]])
    runs = ConnectedRuns.of(right, 10)
    assert runs.first.tolist() == [[0, 0, 0, 3, 3]]
    assert runs.last.tolist() == [[2, 2, 2, 4, 4]]
    assert runs.reach.tolist() == [[0, 1, 0, 0, 0]]


def test_run_goes_on_across_the_seam():
    right = np.array([[True, False, True, True]])
    runs = ConnectedRuns.of(right, 10)
    assert runs.first.tolist() == [[-2, -2, 2, 2]]
    assert runs.last.tolist() == [[1, 1, 5, 5]]


def test_run_without_an_end_is_cut():
    runs = ConnectedRuns.of(np.ones((1, 6), dtype=bool), 2)
    assert (runs.last - runs.first == 4).all()
    assert (runs.reach == 2).all()
