# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope='session')
def data_dir() -> Path:
    """Folder of the measured data; tests that need it are skipped where it is absent."""
    named = os.environ.get('IVFMC_DATA')
    folder = Path(named) if named else ROOT.parent / 'shared' / 'data'
    if folder.is_dir():
        return folder
    if named:
        pytest.fail(f'IVFMC_DATA names {named}, which is no folder')
    pytest.skip(f'no measured data in {folder}; IVFMC_DATA can name another folder')
