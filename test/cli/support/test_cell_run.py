# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import pytest
from support.small_cell import small_cell_options
from support.synthetic import small_cell

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import command
from ivfmc_ros.cli.support.cell_run import parse_overrides
from ivfmc_ros.cli.support.cell_run import write_simulated
from ivfmc_ros.errors import CellError


@pytest.fixture
def run(tmp_path):
    """A cell whose table has a name of its own, in a folder as people name them."""
    cell = small_cell()
    folder = tmp_path / 'Prüfling: 1 [neu]'
    folder.mkdir()
    table = replace(cell.turntable, joint='axis')
    save_cell(folder / 'cell.yaml', replace(cell, turntable=table))
    return CellRun(folder=folder, scans=folder / 'scans', config=folder, cell=folder / 'cell.yaml')


def parameters(words):
    return [words[index + 1] for index, word in enumerate(words) if word == '-p']


@pytest.mark.parametrize('node', ['orchestrator', 'turntable'])
def test_table_has_the_name_that_the_cell_gives_it(run, node):
    assert 'joint:=axis' in parameters(command(run, node))


def test_simulated_camera_of_a_cell_with_a_trigger_is_connected_to_it(run):
    words = parameters(command(replace(run, simulate=True), 'camera'))
    assert not any(word.startswith('trigger') for word in words)
    cell = small_cell()
    table = replace(cell.turntable, trigger_step=0.02)
    save_cell(run.cell, replace(cell, turntable=table))
    words = parameters(command(replace(run, simulate=True), 'camera'))
    assert {'trigger:=table', 'triggered:=false'} <= set(words)


def test_what_is_set_by_hand_is_stronger(run):
    overrides = parse_overrides(['turntable.joint=other', 'turntable.velocity=2'])
    words = parameters(command(replace(run, overrides=overrides), 'turntable'))
    assert words == ['joint:=other', 'velocity:=2']


def test_any_cell_can_be_simulated(tmp_path):
    _, _, cell, _, camera = small_cell_options(tmp_path)
    written, written_camera = write_simulated(tmp_path / 'run', Path(cell), Path(camera))
    found = load_cell(written, load_camera(written_camera))
    assert found.camera.size == (640, 512)
    # known to the cell, as the simulated light has it
    assert all(laser.thickness > 0.0 for laser in found.lasers)


def test_cell_with_more_lasers_than_the_simulated_controller_switches_is_refused(tmp_path):
    cell = small_cell()
    three = [replace(cell.lasers[0], name=name) for name in ('left', 'right', 'top')]
    save_cell(tmp_path / 'cell.yaml', replace(cell, lasers=tuple(three)))
    save_camera(tmp_path / 'camera.yaml', cell.camera)
    with pytest.raises(CellError, match='has 2 outputs, the cell has 3 lasers'):
        write_simulated(tmp_path / 'run', tmp_path / 'cell.yaml', tmp_path / 'camera.yaml')
