# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import hashlib

import pytest

from ivfmc_ros.acceptance.record import write_record
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.title_block import source_texts
from ivfmc_ros.scan.title_block import title_block
from ivfmc_ros.scan.title_block import without_folder
from ivfmc_ros.simulation.bench import bench_cell


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / '20261127T145851Z_bracket'
    folder.mkdir()
    return folder


def test_block_says_what_was_measured_when_and_how(folder):
    save_cell(folder / 'cell.yaml', bench_cell())
    scan_folder.save_parameters(folder, {'part': 'bracket'})
    request = {'part': 'bracket', 'recipe': 'bracket_rough'}
    job = {'stage': 'DONE', 'code': 'OK', 'cell': 'north', 'request': request}
    scan_folder.save_job(folder, job)
    block = title_block(folder)
    assert block['cell'] == 'north'
    assert block['part'] == 'bracket'
    assert block['recipe'] == 'bracket_rough'
    assert block['time (UTC)'] == '2026-11-27 14:58:51'
    assert block['lasers'] == 'left, right'
    assert block['calibration uncertainty'] == 'not known'
    digest = hashlib.sha256((folder / 'params.yaml').read_bytes()).hexdigest()
    assert digest.startswith(block['settings (SHA-256)'])
    # to be signed
    assert block['operator'] == ''


def test_certificate_of_the_calibration_is_in_the_block(folder):
    cell = bench_cell()
    save_cell(folder / 'cell.yaml', cell)
    assert title_block(folder)['certificate'] == 'none: the cell was never checked'
    own = calibration_id(cell.turntable, cell.lasers)
    assert title_block(folder)['calibration'].endswith(f', id {own}')
    record = {'created': '2026-11-20T09:00:00+00:00', 'verdict': 'fail', 'calibration': own}
    write_record(folder / 'cell.check.json', record)
    assert title_block(folder)['certificate'] == 'fail on 2026-11-20'


@pytest.mark.parametrize(
    ('board', 'text'),
    [
        ({'kind': 'x', 'scale': 'a', 'turntable_scale': 'the squares of b'}, 'the squares of b'),
        ({'kind': 'chessboard', 'square_m': 0.014}, 'kind chessboard, square_m 0.014'),
        ('a gauge', 'a gauge'),
        (
            {'turntable_scale': 'the laser', 'scale_doubt': 0.006},
            'the laser, relative u = 0.0035, the known lengths of the calibration differ by '
            '0.60 %: lengths may be 0.60 mm in 100 mm too large',
        ),
    ],
)
def test_scale_is_named_by_the_length_that_gave_it(folder, board, text):
    save_cell(folder / 'cell.yaml', replace(bench_cell(), notes={'board': board}))
    assert title_block(folder)['scale from'] == text


def test_source_that_is_no_scan_gives_what_its_cell_states(folder):
    assert source_texts(folder) == {}
    save_cell(folder / 'cell.yaml', bench_cell())
    assert {'lasers', 'calibration', 'certificate'} <= set(source_texts(folder))
    assert 'scan' not in source_texts(folder)
    scan_folder.save_job(folder, {'stage': 'DONE', 'request': {'part': 'bracket'}})
    assert source_texts(folder)['part'] == 'bracket'
    assert source_texts(folder)['scan'] == folder.name


def test_folder_without_its_files_has_what_its_name_says(folder):
    (folder / 'cell.yaml').write_text('no: cell')
    block = title_block(folder)
    assert set(block) == {'scan', 'time (UTC)', 'software', 'operator'}


def test_paths_of_the_scan_become_names(folder):
    (folder / 'mesh.stl').touch()
    figures = {
        'paths': {'stl': f'{folder}/mesh.stl'},
        'detail': f'{folder}/scan.mcap: is damaged',
        'list': [str(folder), 3, None],
        'moved': '/elsewhere/20261127T145851Z_bracket/mesh.stl',
        'ratio': '1/2',
    }
    assert without_folder(figures, folder) == {
        'paths': {'stl': 'mesh.stl'},
        'detail': 'scan.mcap: is damaged',
        'list': ['20261127T145851Z_bracket', 3, None],
        'moved': 'mesh.stl',
        'ratio': '1/2',
    }
