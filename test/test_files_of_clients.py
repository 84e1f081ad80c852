# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files and folders that a client names by a parameter."""

import os
from pathlib import Path
import threading

import pytest

from ivfmc_ros import files
from ivfmc_ros.angles import load_angles
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pictures import read_picture


def outcome(function, path):
    """Return what ``function(path)`` raises; fails where it blocks."""
    found = []

    def call():
        try:
            function(path)
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(10.0)
    assert found, f'{function.__name__} blocks on {path}'
    return found[0]


@pytest.mark.parametrize('load', [load_draft, load_camera, load_angles, read_picture])
@pytest.mark.parametrize('kind', ['fifo', 'device', 'folder'])
def test_what_is_no_regular_file_is_refused_without_blocking(tmp_path, load, kind):
    path = {'fifo': tmp_path / 'cell.yaml', 'device': Path('/dev/zero'), 'folder': tmp_path}[kind]
    if kind == 'fifo':
        os.mkfifo(path)
    error = outcome(load, path)
    assert isinstance(error, CellError | FileError)
    assert str(path) in str(error)
    assert 'is no regular file' in str(error) or 'Is a directory' in str(error)


@pytest.mark.parametrize('load', [load_draft, load_camera, load_angles])
def test_huge_file_is_refused_unread(tmp_path, load):
    path = tmp_path / 'cell.yaml'
    with path.open('wb') as stream:
        stream.truncate(10**12)  # sparse
    assert 'has 1000000000000 bytes' in str(outcome(load, path))


@pytest.mark.parametrize('load', [load_draft, load_camera, load_angles])
def test_byte_order_mark_is_no_fault(tmp_path, load):
    (tmp_path / 'a.yaml').write_bytes('\ufeffversion: 7\n'.encode())
    error = outcome(load, tmp_path / 'a.yaml')
    # read as a mapping: what is wrong is a key
    assert 'version: ' in str(error) or 'is missing' in str(error)


def test_folder_below_the_root_is_accepted_absolute_and_relative(tmp_path):
    assert files.folder_below(tmp_path, 's1', 'scan_folder') == tmp_path / 's1'
    assert files.folder_below(tmp_path, str(tmp_path / 's1'), 'scan_folder') == tmp_path / 's1'


@pytest.mark.parametrize('folder', ['/tmp', '..', '.', '', '../other', 's1/../..', 'link', 'a\0b'])
def test_folder_that_is_not_below_the_root_is_refused(tmp_path, folder):
    root = tmp_path / 'scans'
    root.mkdir()
    (root / 'link').symlink_to(tmp_path)
    with pytest.raises(ParameterError, match='scan_folder: '):
        files.folder_below(root, folder, 'scan_folder')
