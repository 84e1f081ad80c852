# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A laser whose relay is welded: the images show it, whatever the controller reports."""

import json

import pytest
from support.small_cell import small_cell_options

from ivfmc_ros.simulation.live.folder import LiveFolder

SCAN = {'motion': 'continuous', 'profiles': 80, 'profile_rate': 13.0, 'lasers': ['left']}


@pytest.mark.slow
def test_welded_relay_ends_the_scan(client, start, tmp_path):
    client.status.clear()
    cell = start(*small_cell_options(tmp_path))
    client.until(lambda: client.status, 60.0, cell.log())

    def scan(fault):
        client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log())
        assert client.set('orchestrator', **SCAN).successful
        success, answer = client.trigger('start_scan')
        assert success, answer
        client.until(lambda: state('scan_id') == answer['scan_id'], 10.0, cell.log())
        client.until(lambda: int(state('profiles_done') or 0) > 5, 60.0, cell.log())
        with LiveFolder(cell.folder / 'simulation').faults.open('w', encoding='utf-8') as pipe:
            pipe.write(fault)
        client.until(lambda: state('result'), 90.0, cell.log())
        return json.loads(state('result'))

    def state(key):
        return {item.key: item.value for item in client.status[-1].values}[key]

    answer = scan('stick\n')
    assert answer['code'] == 'LASER_STUCK', answer
    assert 'laser left is reported off and shines' in answer['detail']
    assert scan('release\n')['code'] == 'OK'
