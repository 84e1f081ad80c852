# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells that are started for a test, and end with it."""

import os
import signal

import pytest
from support.cell_rig import Cell
from support.graph_rig import following_client


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


@pytest.fixture(scope='module')
def start(tmp_path_factory):
    """Start a cell; its processes are killed at the end of the module."""
    cells = []

    def start(*arguments):
        # spaces, brackets and non-ASCII letters in the path
        folder = tmp_path_factory.mktemp('cell') / 'Prüfling 1 [neu]'
        cells.append(Cell(folder, *map(str, arguments)))
        return cells[-1]

    yield start
    for cell in cells:
        if cell.up.poll() is None:
            cell.up.kill()
        for pid in cell.processes():
            os.kill(pid, signal.SIGKILL)
