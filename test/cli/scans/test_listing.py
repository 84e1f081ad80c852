# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from click.testing import CliRunner
import pytest

from ivfmc_ros.cli.scans import scans
from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import command
from ivfmc_ros.cli.support.cell_run import parse_overrides
from ivfmc_ros.cli.support.cell_run import write_simulated
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.profile_location import ProfileLocation


@pytest.fixture
def root(tmp_path):
    """Folder with the scans s1 (one profile, one result) and s2."""
    catalogue = Catalogue(tmp_path, create=True)
    catalogue.add_scan('s1', 'bracket', '', 'DONE', {'profiles': 200})
    catalogue.add_scan('s2', 'flange', '', 'FAILED', {})
    mark = ProfileHeader(seq=0, view=0, laser=1, angle=0.5, points=7, stamp_ns=1)
    catalogue.add_profiles(
        's1', [ProfileLocation(header=mark, topic='/p', index=0, log_time_ns=1, chunk_offset=8)]
    )
    catalogue.add_result('s1', 's1', {})
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(scans, [str(item) for item in arguments])


def test_scans_are_listed(root):
    answer = run('list', '--scans', root)
    assert 's1' in answer.output
    assert 'flange' in answer.output
    assert 'flange' not in run('list', '--scans', root, '--part', 'bracket').output


def test_scan_is_shown_with_views_and_results(root):
    answer = run('show', 's1', '--scans', root)
    assert answer.exit_code == 0, answer.exception
    assert 'profiles: 200' in answer.output
    assert '28.65' in answer.output
    assert 'result 0' in answer.output


def test_unknown_scan_is_refused(root):
    assert isinstance(run('show', 'nope', '--scans', root).exception, CatalogueError)


def test_folder_without_scans_is_refused(tmp_path):
    assert isinstance(run('list', '--scans', tmp_path).exception, CatalogueError)


def test_node_gets_its_files_and_its_parameters(tmp_path):
    cell, camera = write_simulated(tmp_path)
    config = tmp_path / 'config'
    config.mkdir()
    (config / 'triangulator.yaml').write_text('')
    run = CellRun(
        folder=tmp_path,
        scans=tmp_path / 'scans',
        config=config,
        cell=cell,
        camera=camera,
        overrides=parse_overrides(['triangulator.volume.bottom=0.001', 'camera.device=0']),
    )
    words = command(run, 'triangulator')
    assert words[words.index('--params-file') + 1] == str(config / 'triangulator.yaml')
    assert f'cell:={cell}' in words
    assert 'volume.bottom:=0.001' in words
    assert f'camera_info:={camera}' in command(run, 'camera')
    assert '--params-file' not in command(run, 'camera')


@pytest.mark.parametrize('item', ['x', 'camera', 'camera.rate', 'robot.x=1', 'camera.=1'])
def test_override_of_another_form_is_refused(item):
    with pytest.raises(ParameterError, match='--set'):
        parse_overrides([item])


def test_report_of_a_scan_is_printed(root, monkeypatch):
    printed = []
    monkeypatch.setattr(
        'ivfmc_ros.cli.scans.exchange.print_pdf', lambda page, pdf: printed.append((page, pdf))
    )
    folder = Catalogue(root).scan('s1').folder
    answer = run('report', 's1', '--scans', root, '-o', root / 'a.pdf')
    assert answer.exit_code == 0, answer.exception
    assert 'a.pdf' in answer.output
    run('report', 's1', '--scans', root, '-o', root / 'b.pdf', '--inspection')
    assert printed == [
        (folder / 'report.html', root / 'a.pdf'),
        (folder / 'inspection.html', root / 'b.pdf'),
    ]


def test_report_that_was_not_written_is_named(root):
    answer = run('report', 's2', '--scans', root, '-o', root / 'a.pdf')
    # a browser is looked for first
    assert isinstance(answer.exception, FileError | NotReadyError)
    assert not (root / 'a.pdf').exists()
