# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans in the whole graph, asked for by a plain client."""

import os
from pathlib import Path
import signal

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from support.cell_rig import gone

from ivfmc_ros.meshing.io.stl import read_stl
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.surface import Surface


@pytest.fixture(scope='module')
def cell(start_shared, client):
    cell = start_shared(
        '--simulate', '--on-exit', 'stop',
        '--set', 'triangulator.volume.bottom=0.0005', '--set', 'mesher.mesh.voxel=0.0006',
    )  # fmt: skip
    client.until(lambda: client.status, 60.0, cell.log())
    return cell


def scan(client, seconds=150.0, **values):
    result = client.set('orchestrator', **values)
    assert result.successful, result.reason
    success, answer = client.trigger('scan', seconds)
    assert success, answer
    return answer


def lasers_on(client):
    """Names of the lasers that are on, by the messages of the driver from now on."""
    states = client.collect(JointState, 'laser_states')
    client.spin(0.8)
    last = states[-1]
    return [name for name, on in zip(last.name, last.position, strict=True) if on]


def deviation(client, answer):
    part = demo_part()
    client.until(lambda: _values(client)['report'], 120.0, 'no report')
    page = Path(_values(client)['report']).read_text()
    # one laser leaves the registration nothing to move
    assert any(text in page for text in ('poses of the table were kept', 'after registration'))
    assert 'with the stripe found' in page
    vertices, _ = read_stl(Path(answer['files']['mesh.stl']))
    distance = Surface(part.vertices_xyz, part.faces).signed_distance(vertices)
    return float(np.sqrt(np.median(distance**2)))


@pytest.mark.slow
def test_step_scan_with_two_lasers(client, cell):
    answer = scan(client, part='bracket', motion='step', profiles=12, lasers=['left', 'right'])
    assert answer['counts']['views'] == 2
    assert answer['counts']['profiles'] == 24
    assert answer['counts']['dropped'] == 0
    assert deviation(client, answer) < 1e-4
    assert set(answer['seconds']) == {
        'preparing', 'scanning', 'registering', 'meshing', 'finishing',
    }  # fmt: skip
    bag = open_bag(Path(answer['folder']))
    assert bag.topics['/ivfmc/profile'].count == 24
    assert {'/ivfmc/image_raw', '/ivfmc/camera_info', '/ivfmc/joint_states',
            '/ivfmc/laser_states', '/ivfmc/view', '/ivfmc/cloud'} <= set(bag.topics)  # fmt: skip
    views = Catalogue(cell.scans).views(answer['scan_id'])
    assert [(view.laser, view.profiles) for view in views] == [(0, 12), (1, 12)]
    assert lasers_on(client) == []


def test_continuous_scan_with_one_laser(client, cell):
    answer = scan(client, motion='continuous', profiles=40, profile_rate=6.0, lasers=['right'])
    (motion,) = answer['registration']['motions']
    assert motion['used'] >= 36
    assert motion['why'] == ''
    assert motion['dropped'] > 0  # the lead-in and the lead-out
    assert deviation(client, answer) < 1e-4
    assert lasers_on(client) == []


def test_busy_cell_refuses_and_cancel_turns_the_laser_off(client, cell):
    client.set('orchestrator', motion='step', profiles=100, lasers=['left'])
    _, first = client.trigger('start_scan')
    client.until(lambda: _counted(client, first) > 0, 60.0, cell.log())
    success, answer = client.trigger('scan', 2.0)
    assert (success, answer['code'], answer['scan_id']) == (False, 'BUSY', first['scan_id'])
    assert client.trigger('cancel')[0]
    client.until(lambda: _values(client)['code'] == 'CANCELLED', 20.0, cell.log())
    assert lasers_on(client) == []
    # the bag of the cancelled scan is readable
    assert open_bag(cell.scans / first['scan_id']).topics['/ivfmc/profile'].count > 0


def test_camera_that_is_killed_fails_the_scan_and_ends_the_cell(client, cell):
    client.set('orchestrator', motion='step', profiles=100, lasers=['left'])
    client.trigger('start_scan')
    client.until(lambda: _values(client)['stage'] == 'SCANNING', 60.0, cell.log())

    os.kill(cell.id_of('camera'), signal.SIGKILL)
    assert cell.up.wait(30.0) == 1
    assert 'camera was killed by signal 9' in cell.up.stderr.read()
    assert gone(cell)


def _counted(client, scan):
    values = _values(client)
    return int(values['profiles_done']) if values['scan_id'] == scan['scan_id'] else 0


def _values(client):
    return {item.key: item.value for item in client.status[-1].values}
