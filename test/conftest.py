# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Boards, cameras and nodes in these live in real time; tests that compute would make them late.
REALTIME = (
    'cli/support/test_processes.py',
    'devices',
    'nodes/test_camera.py',
    'nodes/test_live_is_offline.py',
    'nodes/test_orchestrator.py',
    'nodes/test_scan_of_a_bad_table.py',
    'nodes/test_turntable.py',
    'simulation/test_live_cell.py',
)
# Whole cells, each of which takes what the machine has.
ALONE = ('graph',)
# The longest files, which would keep one worker busy when the other has ended.
FIRST = ('test_orchestrator.py', 'test_registrar_and_mesher.py', 'test_triangulator.py')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what must not share the machine, and begin with the longest files."""
    for mark, names in (('realtime', REALTIME), ('alone', ALONE)):
        places = [ROOT / 'test' / name for name in names]
        for item in items:
            if any(item.path.is_relative_to(place) for place in places):
                item.add_marker(mark)
    items.sort(key=lambda item: item.path.name not in FIRST)


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
