# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cell on disk, the sphere in it, and a client of the graph."""

import numpy as np
import pytest
from support.cell_inputs import Inputs
from support.fake_cell import FakeCell
from support.graph_rig import Client
from support.graph_rig import NodeProcess
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.cell.cell_file import save_cell

STEPS = 40


@pytest.fixture
def client():
    client = Client()
    yield client
    client.close()


@pytest.fixture
def fake(client):
    """The other nodes of a cell, as far as an orchestrator needs them."""
    fake = FakeCell(client)
    yield fake
    fake.close()


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Write the source of a node, which NodeProcess then starts instead of one of the package."""

    def write(text):
        path = tmp_path / 'node.py'
        path.write_text(text)
        original = NodeProcess.command
        monkeypatch.setattr(
            NodeProcess, 'command', lambda self, name: [*original(self, name)[:1], str(path)]
        )

    return write


@pytest.fixture(scope='session')
def cell():
    return small_cell()


@pytest.fixture(scope='session')
def cell_file(cell, tmp_path_factory):
    path = tmp_path_factory.mktemp('cell') / 'cell.yaml'
    save_cell(path, cell)
    return path


@pytest.fixture(scope='session')
def sphere():
    return Sphere(np.array([0.004, 0.002, 0.03]), 0.02)


@pytest.fixture(scope='session')
def frames(cell, sphere):
    """Frames of one turn in steps with each of the two lasers."""
    found = []
    for laser in (0, 1):
        found += sphere_frames(cell, sphere, STEPS, laser=laser, view=laser, seed=laser + 1)
    return found


@pytest.fixture
def inputs(client, cell):
    return Inputs(client, cell)
