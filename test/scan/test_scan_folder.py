# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from datetime import datetime
from datetime import UTC
import errno
import os
from pathlib import Path

import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan import scan_folder

NOW = datetime(2026, 11, 23, 10, 15, tzinfo=UTC)


def test_scans_of_one_second_get_numbered_folders(tmp_path):
    root = tmp_path / 'scans'
    names = [scan_folder.create_scan_folder(root, 'bracket', NOW).name for _ in range(2)]
    assert names == ['20261123T101500Z_bracket', '20261123T101500Z_bracket_2']


def test_part_cannot_leave_the_root(tmp_path):
    with pytest.raises(ParameterError):
        scan_folder.create_scan_folder(tmp_path / 'scans', '../x', NOW)
    assert list(tmp_path.iterdir()) == []


def test_root_that_is_a_file_is_named(tmp_path):
    (tmp_path / 'scans').write_text('')
    with pytest.raises(FileError, match='scans'):
        scan_folder.create_scan_folder(tmp_path / 'scans', 'bracket', NOW)


def test_job_is_read_as_it_was_written(tmp_path):
    scan_folder.save_job(tmp_path, {'stage': 'SCANNING', 'views_done': 1})
    assert scan_folder.load_job(tmp_path)['views_done'] == 1


@pytest.mark.parametrize('text', ['', '[]', '{"stage": "ASLEEP"}'])
def test_invalid_job_file_is_refused(tmp_path, text):
    (tmp_path / scan_folder.JOB_FILE).write_text(text)
    with pytest.raises(FileError, match=scan_folder.JOB_FILE):
        scan_folder.load_job(tmp_path)


def test_interrupted_scans_are_marked_and_others_are_not(tmp_path):
    for name, stage in (('a', 'SCANNING'), ('b', 'DONE'), ('c', 'PAUSED')):
        (tmp_path / name).mkdir()
        scan_folder.save_job(tmp_path / name, {'stage': stage})
    (tmp_path / 'd').mkdir()
    (tmp_path / 'd' / scan_folder.JOB_FILE).write_text('not ours')
    assert scan_folder.mark_interrupted_scans(tmp_path) == (['a', 'c'], [])
    assert scan_folder.load_job(tmp_path / 'a')['code'] == 'INTERRUPTED'
    assert scan_folder.load_job(tmp_path / 'b') == {'stage': 'DONE'}
    assert scan_folder.mark_interrupted_scans(tmp_path) == ([], [])


def test_locked_scan_is_not_marked(tmp_path):
    folder = tmp_path / 'a'
    folder.mkdir()
    scan_folder.save_job(folder, {'stage': 'SCANNING'})
    with scan_folder.lock_scan(folder) as mine, scan_folder.lock_scan(folder) as other:
        assert (mine, other) == (True, False)
        assert scan_folder.mark_interrupted_scans(tmp_path) == ([], [])
    assert scan_folder.mark_interrupted_scans(tmp_path) == (['a'], [])


def test_unreadable_scan_folder_is_named_and_the_others_are_marked(tmp_path, monkeypatch):
    for name in ('a', 'b', 'c'):
        (tmp_path / name).mkdir()
        scan_folder.save_job(tmp_path / name, {'stage': 'SCANNING'})
    opened = os.open

    def refuse(path, *arguments, **options):
        if Path(path).name == 'a':
            raise PermissionError(errno.EACCES, 'Permission denied', str(path))
        return opened(path, *arguments, **options)

    monkeypatch.setattr(os, 'open', refuse)
    marked, (error,) = scan_folder.mark_interrupted_scans(tmp_path)
    assert marked == ['b', 'c']
    assert error == f'{tmp_path / "a"}: cannot be read: Permission denied'


def test_job_file_that_cannot_be_written_is_named_and_the_others_are_marked(tmp_path, monkeypatch):
    for name in ('a', 'b'):
        (tmp_path / name).mkdir()
        scan_folder.save_job(tmp_path / name, {'stage': 'SCANNING'})
    save = scan_folder.save_job

    def refuse(folder, document):
        if folder.name == 'a':
            raise FileError('a/job.json: cannot be written: Read-only file system')
        save(folder, document)

    monkeypatch.setattr(scan_folder, 'save_job', refuse)
    marked, errors = scan_folder.mark_interrupted_scans(tmp_path)
    assert (marked, len(errors)) == (['b'], 1)


def test_job_file_that_is_a_fifo_blocks_nothing(tmp_path):
    (tmp_path / 'a').mkdir()
    os.mkfifo(tmp_path / 'a' / scan_folder.JOB_FILE)
    assert scan_folder.mark_interrupted_scans(tmp_path) == ([], [])
