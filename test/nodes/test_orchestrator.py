# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import math

from diagnostic_msgs.msg import DiagnosticStatus
from fake_cell import FakeCell
from graph_rig import NodeProcess
from graph_rig import running
import pytest
from std_msgs.msg import UInt64

from ivfmc_ros.scan import record
from ivfmc_ros.storage.catalogue import Catalogue

KEYS = {
    'scan_id', 'stage', 'views_done', 'views_total', 'profiles_done', 'profiles_total', 'eta_s',
    'code', 'result',
}  # fmt: skip


@pytest.fixture
def fake(client):
    fake = FakeCell(client)
    yield fake
    fake.close()


@pytest.fixture
def root(tmp_path):
    return tmp_path / 'scans'


@pytest.fixture
def orchestrator(client, cell_file, root):
    values = {
        'cell': str(cell_file),
        'scan_root': str(root),
        'motion': 'step',
        'profiles': 3,
        'velocity': 20.0,
        'acceleration': 200.0,
        'heartbeat_limit': 1.0,
    }
    with running('orchestrator', **values) as node:
        client.status = client.collect(DiagnosticStatus, 'scan_status')
        client.until(lambda: client.status, 15.0, 'no scan_status')
        yield node


def values_of(client):
    return {item.key: item.value for item in client.status[-1].values}


def await_stage(client, *stages, seconds=30.0):
    client.until(lambda: values_of(client)['stage'] in stages, seconds, f'not {stages}')
    return values_of(client)


def test_step_scan_with_a_foreign_table(client, fake, orchestrator, root):
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert answer['code'] == 'OK'
    assert answer['counts']['profiles'] == 6
    assert answer['registration'] == {'said': 'registrar/register'}
    assert set(answer['files']) >= {'cell.yaml', 'camera.yaml', 'params.yaml', 'mesh.stl',
                                    'mesh.png', 'report.html', 'report.json',
                                    'job.json'}  # fmt: skip
    assert fake.called == [
        'registrar/reset', 'recorder/start', 'registrar/register', 'mesher/build',
        'recorder/stop',
    ]  # fmt: skip
    assert fake.parameter('recorder', 'scan_id') == answer['scan_id']
    assert fake.holds[-1][1] == ''
    status = values_of(client)
    assert set(status) == KEYS
    assert (status['stage'], status['code']) == ('DONE', 'OK')
    assert json.loads(status['result'])['scan_id'] == answer['scan_id']
    assert Catalogue(root).scan(answer['scan_id']).stage == 'DONE'
    assert record.load_job(root / answer['scan_id'])['stage'] == 'DONE'


def test_continuous_scan_is_one_sweep_a_laser(client, fake, orchestrator):
    client.set('orchestrator', motion='continuous', profiles=12, profile_rate=30.0)
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert answer['counts']['views'] == 2
    assert fake.position > 4 * math.pi


def test_new_scan_does_not_count_what_the_one_before_recorded(client, fake, orchestrator):
    recorded = client.publisher(UInt64, 'recorded')
    before = len(client.status)
    assert client.trigger('start_scan')[0]
    while values_of(client)['stage'] in ('IDLE', 'PREPARING'):
        # as a recorder does that has not been started yet
        recorded.publish(UInt64(data=4))
        client.spin(0.02)
    values = [
        {item.key: item.value for item in status.values} for status in client.status[before:]
    ]
    preparing = [v['profiles_done'] for v in values if v['stage'] in ('IDLE', 'PREPARING')]
    assert preparing
    assert set(preparing) == {'0'}
    client.trigger('cancel')


def test_second_scan_is_refused_at_once_and_names_the_first(client, fake, orchestrator):
    _, first = client.trigger('start_scan')
    success, answer = client.trigger('scan', 2.0)
    assert not success
    assert (answer['code'], answer['scan_id']) == ('BUSY', first['scan_id'])
    client.trigger('cancel')
    await_stage(client, 'CANCELLED')


def test_cancel_ends_the_scan_and_the_beam(client, fake, orchestrator, root):
    client.set('orchestrator', profiles=200)
    _, answer = client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    assert client.trigger('cancel')[0]
    assert await_stage(client, 'CANCELLED', seconds=5.0)['code'] == 'CANCELLED'
    assert fake.holds[-1][1] == ''
    assert 'recorder/stop' in fake.called
    assert Catalogue(root).scan(answer['scan_id']).code == 'CANCELLED'
    success, answer = client.trigger('cancel')
    assert (success, answer['code']) == (False, 'WRONG_STATE')


def test_pause_holds_the_scan_without_a_beam(client, fake, orchestrator):
    client.set('orchestrator', profiles=5)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    assert client.trigger('pause')[0]
    await_stage(client, 'PAUSED')
    seq = fake.seq
    client.spin(1.0)
    assert (fake.seq, fake.beam) == (seq, '')
    assert client.trigger('resume')[0]
    assert await_stage(client, 'DONE')['profiles_done'] == '10'


@pytest.mark.parametrize('service', ['pause', 'resume', 'cancel'])
def test_without_a_scan_it_is_refused(client, fake, orchestrator, service):
    success, answer = client.trigger(service)
    assert (success, answer['code']) == (False, 'WRONG_STATE')


def test_silent_helper_fails_the_scan_by_its_name(client, fake, orchestrator):
    client.set('orchestrator', profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    fake.silent.add('registrar')
    status = await_stage(client, 'FAILED', seconds=10.0)
    assert status['code'] == 'REGISTRAR_LOST'
    assert fake.holds[-1][1] == ''
    fake.silent.clear()
    client.set('orchestrator', profiles=3)
    assert client.trigger('scan', 60.0)[0]


def test_error_of_a_helper_keeps_its_code(client, fake, orchestrator):
    fake.answers['registrar/register'] = {'code': 'DEGENERATE', 'detail': 'no surface'}
    success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'DEGENERATE')
    assert 'no surface' in answer['detail']
    assert fake.called[-1] == 'recorder/stop'


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('part', '../x'),
        ('part', ';id;'),
        ('recipe', 'a/b'),
        ('profiles', 1),
        ('overlap', math.nan),
        ('motion', 'jump'),
        ('velocity', -1.0),
        ('formats', ['exe']),
    ],
)
def test_parameter_that_makes_no_scan_is_refused_by_name(client, orchestrator, name, value):
    result = client.set('orchestrator', **{name: value})
    assert not result.successful
    assert name in result.reason


def test_unknown_laser_is_refused_when_a_scan_is_asked_for(client, orchestrator, root):
    client.set('orchestrator', lasers=['top'])
    success, answer = client.trigger('start_scan')
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')
    assert not root.exists()


def test_scan_that_was_cut_off_is_marked_at_the_next_start(client, cell_file, root):
    Catalogue(root, create=True).add_scan('s1', 'part', '', 'SCANNING', {})
    (root / 's1').mkdir()
    record.save_job(root / 's1', {'stage': 'SCANNING'})
    node = NodeProcess('orchestrator', cell=str(cell_file), scan_root=str(root))
    status = client.collect(DiagnosticStatus, 'scan_status')
    try:
        client.until(lambda: status, 15.0, 'no scan_status')
    finally:
        node.end()
    assert Catalogue(root).scan('s1').code == 'INTERRUPTED'
