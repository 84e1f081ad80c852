# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan in the whole graph whose camera is triggered by the table."""

from dataclasses import replace
import math

import pytest

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.simulation.bench import bench_cell

STEP = math.radians(3.0)


@pytest.mark.slow
def test_triggered_scan_has_angles_on_the_grid_and_says_which_triggers_were_dropped(
    client, start, tmp_path
):
    bench = bench_cell()
    table = replace(bench.turntable, trigger_step=STEP)
    save_cell(tmp_path / 'cell.yaml', replace(bench, turntable=table))
    save_camera(tmp_path / 'camera.yaml', bench.camera)
    files = ('--cell', tmp_path / 'cell.yaml', '--camera', tmp_path / 'camera.yaml')
    cell = start('--simulate', '--on-exit', 'stop', *files, '--set', 'mesher.mesh.voxel=0.001')
    client.until(lambda: client.status, 60.0, cell.log())
    # on a busy computer the nodes come up one after the other
    nodes = ('triangulator', 'registrar', 'mesher', 'recorder')
    client.until(lambda: all(client.diagnostic(node) for node in nodes), 60.0, cell.log())
    (cell.folder / 'simulation' / 'faults').write_text('trigger drop 0.1\n')
    values = {'motion': 'continuous', 'profiles': 40, 'profile_rate': 6.0, 'lasers': ['right']}
    result = client.set('orchestrator', **values)
    assert result.successful, result.reason
    success, answer = client.trigger('scan', 150.0)
    assert success, answer
    (motion,) = answer['registration']['motions']
    trigger = motion['trigger']
    assert trigger['code'] == ''
    assert trigger['kept'] + trigger['dropped'] >= 120
    assert 0 < trigger['dropped'] == len(trigger['dropped_angles'])
    assert f'{trigger["dropped"]} steps without a picture' in answer['detail']
    (view,) = answer['registration']['views']
    for low, high in view['runs']:
        for angle in (low, high):
            steps = (angle - trigger['phase']) / STEP
            assert abs(steps - round(steps)) < 1e-4
