# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One front end reads bags for reconstruct, merge and replay."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import small_camera
from support.synthetic import small_cell

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.merge import merge
from ivfmc_ros.cli.reconstruct import reconstruct
from ivfmc_ros.cli.replay import replay
from ivfmc_ros.cli.support.source import bag_of
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_bag
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.bag.writer import create_bag

STEP = 100_000_000


@pytest.fixture
def folder(tmp_path):
    """Bag of eight images beside the cell.yaml of a table whose joint is axis_1."""
    camera = small_camera()
    cell = small_cell(camera)
    cell = replace(cell, turntable=replace(cell.turntable, joint='axis_1'), lasers=cell.lasers[:1])
    image = np.zeros((camera.height, camera.width), dtype=np.uint8)
    with create_bag(tmp_path / 'bag', compress=False) as bag:
        for index in range(8):
            bag.joint_state(index * STEP, 'axis_1', 0.1 * index)
            bag.camera_info(index * STEP, camera)
            bag.image(index * STEP, image)
    save_cell(tmp_path / 'bag' / 'cell.yaml', cell)
    return tmp_path / 'bag'


def test_joint_is_that_of_the_cell(folder):
    scan, cell = read_scan(folder, None, None, BagOptions())
    assert (scan.frame_count, cell.turntable.joint) == (8, 'axis_1')


def test_interrupted_scan_is_read_and_said(folder, capsys):
    (folder / 'metadata.yaml').unlink()
    (folder / 'scan.mcap').rename(folder / 'scan.mcap.part')
    for path in (folder, folder / 'scan.mcap.part'):
        scan, _ = read_scan(path, None, None, BagOptions())
        assert scan.frame_count == 8
        said = capsys.readouterr().err
        assert said.startswith('ivfmc: warning: ')
        assert 'the recording was not finished' in said


def test_damaged_bag_is_read_by_the_option_that_its_refusal_names(folder, capsys):
    path = folder / 'scan.mcap'
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 8 // 10])
    with pytest.raises(BagError, match='--salvage'):
        read_scan(path, None, None, BagOptions.of((), salvage=False))
    bag, _ = read_bag(path, BagOptions.of((), salvage=True))
    assert bag.damage in capsys.readouterr().err


@pytest.mark.parametrize('command', [reconstruct, merge, replay])
def test_all_commands_that_read_bags_have_the_same_options(command):
    names = {option for parameter in command.params for option in parameter.opts}
    assert {'--role', '--salvage'} <= names


def test_role_without_a_topic_is_refused():
    with pytest.raises(ParameterError, match='must be ROLE=TOPIC'):
        BagOptions.of(('image',), salvage=False)


def test_part_that_does_not_exist_is_no_scan_id():
    with pytest.raises(FileError, match='no such bag'):
        bag_of('scan.mcap.part')


@pytest.mark.parametrize('name', ['bag.mcap.zstd', 'scans/s1', 'bag_0.db3.zst'])
def test_missing_bag_is_not_taken_for_a_scan(name):
    with pytest.raises(FileError, match='there is no such bag'):
        bag_of(name)


def test_cell_before_a_scan_id_is_that_of_a_plant(monkeypatch):
    monkeypatch.setenv('IVFMC_CATALOGUE', 'postgresql+psycopg://db/ivfmc')
    assert bag_of('cell07/s1') is None
    with pytest.raises(FileError, match='there is no such bag'):
        bag_of('scans/cell07/s1')
