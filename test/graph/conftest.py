# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells that are started for a test, and end with it."""

from contextlib import contextmanager

import pytest
from support.cell_rig import Cell
from support.graph_rig import following_client


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


@contextmanager
def started_cells(tmp_path_factory):
    """Yield a function that starts a cell; all are killed at the end, also after a failure."""
    cells = []

    def start(*arguments):
        # spaces, brackets and non-ASCII letters in the path
        folder = tmp_path_factory.mktemp('cell') / 'Prüfling 1 [neu]'
        cells.append(Cell(folder, *map(str, arguments)))
        return cells[-1]

    try:
        yield start
    finally:
        for cell in cells:
            cell.kill()


@pytest.fixture
def start(tmp_path_factory):
    with started_cells(tmp_path_factory) as start:
        yield start


@pytest.fixture(scope='module')
def start_shared(tmp_path_factory):
    """As ``start``, for cells that all tests of a module use."""
    with started_cells(tmp_path_factory) as start:
        yield start
