# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A laser whose stripe creeps after it was switched on is waited for."""

import pytest
from support.scan_result import await_result
from support.small_cell import small_cell_options
from support.warming_camera import WARM_UP
from support.warming_camera import WarmingCell

SCAN = {'motion': 'continuous', 'profiles': 120, 'profile_rate': 13.0, 'lasers': ['left']}


@pytest.fixture
def cell(tmp_path):
    # 3 pixels at first, and a time constant of 3 s
    cell = WarmingCell(
        tmp_path / 'run', *small_cell_options(tmp_path / 'cell'), **{WARM_UP: '3 3'}
    )
    yield cell
    cell.kill()


@pytest.mark.slow
def test_cold_laser_is_waited_for(client, cell):
    client.status.clear()
    client.until(lambda: client.status, 60.0, cell.log)
    client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log)

    def scanned(**values):
        assert client.set('orchestrator', **SCAN, **values).successful
        success, answer = client.trigger('start_scan')
        assert success, answer
        return await_result(client, answer['scan_id'], 150.0)

    cold = scanned(warm_up=0.0)
    assert 'left by' in cold['registration']['table']['drift'], cold
    doubted = scanned(warm_up=1.0)
    assert 'warm_up: after 1 s' in doubted['detail'], doubted
    warm = scanned(warm_up=60.0)
    assert 'warm_up' not in warm.get('detail', ''), warm
    assert warm['registration']['table']['drift'] == '', warm
