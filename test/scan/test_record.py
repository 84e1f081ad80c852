# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from datetime import datetime
from datetime import UTC

import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan import record

NOW = datetime(2026, 11, 23, 10, 15, tzinfo=UTC)


def test_scans_of_one_second_get_folders_of_their_own(tmp_path):
    names = [record.new_folder(tmp_path / 'scans', 'bracket', NOW).name for _ in range(2)]
    assert names == ['20261123T101500Z_bracket', '20261123T101500Z_bracket_2']


def test_part_cannot_leave_the_root(tmp_path):
    with pytest.raises(ParameterError):
        record.new_folder(tmp_path / 'scans', '../x', NOW)
    assert list(tmp_path.iterdir()) == []


def test_root_that_is_a_file_is_named(tmp_path):
    (tmp_path / 'scans').write_text('')
    with pytest.raises(FileError, match='scans'):
        record.new_folder(tmp_path / 'scans', 'bracket', NOW)


def test_job_is_read_as_it_was_written(tmp_path):
    record.save_job(tmp_path, {'stage': 'SCANNING', 'views_done': 1})
    assert record.load_job(tmp_path)['views_done'] == 1


@pytest.mark.parametrize('text', ['', '[]', '{"stage": "ASLEEP"}'])
def test_job_that_is_none_is_refused(tmp_path, text):
    (tmp_path / record.JOB).write_text(text)
    with pytest.raises(FileError, match=record.JOB):
        record.load_job(tmp_path)


def test_interrupted_scans_are_marked_and_others_are_not(tmp_path):
    for name, stage in (('a', 'SCANNING'), ('b', 'DONE'), ('c', 'PAUSED')):
        (tmp_path / name).mkdir()
        record.save_job(tmp_path / name, {'stage': stage})
    (tmp_path / 'd').mkdir()
    (tmp_path / 'd' / record.JOB).write_text('not ours')
    assert record.close_interrupted(tmp_path) == ['a', 'c']
    assert record.load_job(tmp_path / 'a')['code'] == 'INTERRUPTED'
    assert record.load_job(tmp_path / 'b') == {'stage': 'DONE'}
    assert record.close_interrupted(tmp_path) == []


def test_scan_that_another_process_holds_is_running(tmp_path):
    folder = tmp_path / 'a'
    folder.mkdir()
    record.save_job(folder, {'stage': 'SCANNING'})
    with record.claimed(folder) as mine, record.claimed(folder) as other:
        assert (mine, other) == (True, False)
        assert record.close_interrupted(tmp_path) == []
    assert record.close_interrupted(tmp_path) == ['a']
