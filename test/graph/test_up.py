# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""However a cell ends, nothing of it is left."""

import os
import signal

import pytest
from support.cell_rig import Cell
from support.cell_rig import gone


def start_and_await(client, start, *arguments):
    client.status.clear()
    cell = start('--simulate', *arguments)
    client.until(lambda: client.status, 60.0, cell.log())
    return cell


def test_good_start_logs_no_warning_and_no_error(client, start):
    cell = start_and_await(client, start)
    client.spin(10.0)
    assert cell.end(signal.SIGINT) == 0
    severities = ('[WARN]', '[ERROR]', '[FATAL]')
    assert [line for line in cell.log().splitlines() if any(s in line for s in severities)] == []
    # an input that has not been received yet is information, once
    assert cell.log().count('joint_states: waiting') <= 1


def test_ctrl_c_ends_all_processes(client, start):
    cell = start_and_await(client, start)
    assert len(cell.processes()) >= 8
    # two cells of one namespace would both respond
    second = start('--simulate')
    assert second.up.wait(60.0) == 1
    assert 'a cell is up in /ivfmc already' in second.up.stderr.read()
    assert not second.processes()
    assert cell.end(signal.SIGINT) == 0
    assert gone(cell)
    assert 'Traceback' not in cell.log()
    assert not (cell.folder / 'simulation' / 'controller').exists()


def test_node_that_is_killed_is_started_again(client, start):
    cell = start_and_await(client, start)
    client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log())
    client.status.clear()
    killed = {name: cell.id_of(name) for name in ('orchestrator', 'turntable')}
    for pid in killed.values():
        os.kill(pid, signal.SIGKILL)
    client.until(lambda: client.status, 60.0, cell.log())
    client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log())
    assert all(cell.id_of(name) != pid for name, pid in killed.items())
    assert cell.up.poll() is None
    log = cell.log()
    for text in (
        'orchestrator was killed by signal 9; it is started again in 0.5 s (1 of at most 5)',
        'turntable was killed by signal 9; the motion controller was reset: lasers off',
    ):
        assert text in log
    # no signal was needed to end the new processes
    assert cell.end(signal.SIGINT) == 0
    assert gone(cell)


def test_no_process_remains_when_up_is_killed(client, start):
    cell = start_and_await(client, start)
    assert len(cell.processes()) >= 8
    cell.end(signal.SIGKILL)
    # a camera that is rendering finishes that first
    assert gone(cell, 60.0)


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (('--simulate', '--replay'), 'exclude each other'),
        ((), '--cell cell.yaml is needed'),
        (('--replay', '--home-switch'), 'it needs --simulate'),
        (('--simulate', '--cell', 'cell.yaml'), 'needs both --cell and --camera'),
        (('--cell', 'nowhere.yaml'), 'nowhere.yaml: no such file'),
        (
            ('--simulate', '--namespace', 'my cell'),
            "--namespace 'my cell': must consist of letters",
        ),
        (('--simulate', '--set', 'robot.x=1'), 'must be node.parameter=value'),
        (('--simulate', '--set', 'mesher.display_triangles=5'), 'mesher ended with exit code 2'),
    ],
)
def test_invalid_options_are_rejected(start, arguments, said):
    cell = start(*arguments)
    assert cell.up.wait(60.0) == 1
    assert said in cell.up.stderr.read()
    assert gone(cell)


def test_folder_that_cannot_be_created_is_named(tmp_path):
    (tmp_path / 'taken').write_text('')
    cell = Cell(tmp_path / 'taken', '--cell', __file__)
    assert cell.up.wait(60.0) == 1
    assert cell.up.stderr.read().endswith('taken: cannot be made: File exists\n')
