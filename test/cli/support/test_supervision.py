# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The supervisor of a cell whose nodes are programs that only sleep."""

from contextlib import closing
import os
from pathlib import Path
import signal
import sys
import time

import pytest
from support.graph_rig import node_environment

from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import write_simulated
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.client import result_of
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.cli.support.restarts import MOST
from ivfmc_ros.cli.support.supervision import Supervisor
from ivfmc_ros.errors import HelperError

SLEEP = [sys.executable, '-c', 'import time\nprint("up", flush=True)\ntime.sleep(60)']
REFUSE = [sys.executable, '-c', 'import time, sys\nprint("up", flush=True)\nsys.exit(2)']


class SleepingCell:
    """Nodes that do nothing, and their supervisor."""

    def __init__(self, client, processes, said, run, restart):
        self.client, self.processes, self.said = client, processes, said
        self.supervisor = Supervisor(
            run, processes, client, lambda name, line: said.append((name, line)), restart=restart
        )

    def check_until(self, condition, seconds=60.0):
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, self.said
            self.supervisor.check()
            time.sleep(0.01)

    def text(self):
        return '\n'.join(line for name, line in self.said if name == 'up')


@pytest.fixture
def cells(tmp_path, monkeypatch):
    """Return a function that starts a cell; the programs of its nodes may be given."""
    for name, value in node_environment().items():
        monkeypatch.setenv(name, value)
    cell, camera = write_simulated(tmp_path)
    run = CellRun(
        folder=tmp_path,
        scans=tmp_path / 'scans',
        config=Path(tmp_path / 'none'),
        cell=cell,
        camera=camera,
        nodes=['turntable', 'camera', 'orchestrator'],
    )
    said = []
    with (
        cell_client('/ivfmc') as client,
        Processes(lambda name, line: said.append((name, line))) as processes,
    ):

        def start(*, restart=True, camera=SLEEP):
            programs = {'turntable': SLEEP, 'camera': camera, 'orchestrator': SLEEP}
            for name, program in programs.items():
                processes.start(name, program, os.environ, ready='up')
            return SleepingCell(client, processes, said, run, restart)

        yield start


def test_controller_is_reset_when_its_driver_dies_while_the_nodes_are_looked_at(
    cells, monkeypatch
):
    cell = cells()

    def node_fault(name):
        # the driver was looked at before this node
        os.kill(cell.processes.ids['turntable'], signal.SIGKILL)
        while cell.processes.code_of('turntable') is None:
            time.sleep(0.01)
        monkeypatch.undo()
        return ''

    monkeypatch.setattr(cell.supervisor, '_node_fault', node_fault)
    cell.check_until(lambda: 'turntable was killed by signal 9; it had no' in cell.text())


@pytest.mark.parametrize(
    ('node', 'number', 'said'),
    [
        ('camera', signal.SIGKILL, 'camera was killed by signal 9; it is started again in 0.5 s'),
        ('camera', signal.SIGSTOP, 'camera was stopped by a signal; it is started again'),
        ('turntable', signal.SIGKILL, 'turntable was killed by signal 9; it had no controller;'),
        ('turntable', signal.SIGSTOP, 'turntable was stopped by a signal; it had no controller;'),
    ],
)
def test_node_that_ends_or_stops_is_started_again(cells, node, number, said):
    cell = cells()
    before = cell.processes.ids
    os.kill(before[node], number)
    cell.check_until(lambda: f'{node} is started again' in cell.text().splitlines())
    assert said in cell.text()
    assert cell.processes.ended() is None
    changed = [name for name in before if cell.processes.ids[name] != before[name]]
    assert changed == [node]


def test_node_that_ends_too_often_ends_the_cell(cells, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.cli.support.restarts._FIRST_S', 0.0)
    cell = cells()
    for number in range(MOST):
        os.kill(cell.processes.ids['camera'], signal.SIGKILL)
        cell.check_until(lambda n=number: cell.text().count('camera is started again') == n + 1)
    os.kill(cell.processes.ids['camera'], signal.SIGKILL)
    with pytest.raises(HelperError, match='camera ended 6 times within 10 minutes; the cell is'):
        cell.check_until(lambda: False)


def test_node_that_cannot_be_created_ends_the_cell(cells):
    cell = cells(camera=REFUSE)
    with pytest.raises(HelperError, match='camera ended with exit code 2; the cell is taken down'):
        cell.check_until(lambda: False)


def test_node_that_ends_stops_the_cell_on_request(cells):
    cell = cells(restart=False)
    os.kill(cell.processes.ids['camera'], signal.SIGKILL)
    with pytest.raises(HelperError, match='camera was killed by signal 9; the cell is taken down'):
        cell.check_until(lambda: False)


def test_end_of_the_orchestrator_is_the_end_of_its_scan(cells):
    cell = cells()
    cell.client.status = {'scan_id': 'a', 'stage': 'SCANNING', 'profiles_done': '7'}
    begin = time.monotonic()
    os.kill(cell.processes.ids['orchestrator'], signal.SIGKILL)
    found = []

    def ended():
        cell.client.spin(0.01)
        found.append(result_of(cell.client.status, 'a'))
        return found[-1]

    cell.check_until(ended)
    assert time.monotonic() - begin < 1.5
    assert found[-1]['code'] == 'INTERRUPTED'
    assert 'orchestrator was killed by signal 9' in found[-1]['detail']
    assert cell.client.status['profiles_done'] == '7'


def test_nothing_is_left_on_scan_status_when_the_orchestrator_comes_back(cells):
    cell = cells()
    cell.client.status = {'scan_id': 'a', 'stage': 'SCANNING'}
    os.kill(cell.processes.ids['orchestrator'], signal.SIGKILL)
    cell.check_until(lambda: 'orchestrator is started again' in cell.text().splitlines())
    with closing(CellClient('/ivfmc')) as late:
        late.spin(1.0)
        assert late.status == {}
