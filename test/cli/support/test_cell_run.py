# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest
from support.synthetic import small_cell

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import command
from ivfmc_ros.cli.support.cell_run import parse_overrides


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


def test_what_is_set_by_hand_is_stronger(run):
    overrides = parse_overrides(['turntable.joint=other', 'turntable.velocity=2'])
    words = parameters(command(replace(run, overrides=overrides), 'turntable'))
    assert words == ['joint:=other', 'velocity:=2']
