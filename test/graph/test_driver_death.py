# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A turntable driver that is killed or stopped: the controller is reset, and the cell says why."""

import json
import os
import signal

import pytest
from support.cell_rig import gone


@pytest.mark.parametrize(
    'number', [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.slow)]
)
def test_controller_is_reset_when_its_driver_dies(client, start, number):
    client.status.clear()
    cell = start('--simulate', '--on-exit', 'stop')
    client.until(lambda: client.status, 60.0, cell.log())
    client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log())
    success, answer = client.trigger('start_scan')
    assert success, answer
    os.kill(cell.id_of('turntable'), number)

    def result():
        values = {item.key: item.value for item in client.status[-1].values}
        return json.loads(values['result'] or '{}')

    client.until(lambda: result().get('code') == 'NODE_DIED', 10.0, cell.log())
    assert 'the motion controller was reset: lasers off' in result()['detail']
    assert cell.up.wait(30.0) == 1
    said = 'killed by signal 9' if number is signal.SIGKILL else 'stopped by a signal'
    assert said in cell.up.stderr.read()
    assert gone(cell)
