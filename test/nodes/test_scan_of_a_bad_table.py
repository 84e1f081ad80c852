# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A table that does not move as commanded, or whose controller has a fault, ends the scan."""

import json
import time

import pytest
from std_srvs.srv import Trigger
from support.fake_cell import FakeCell
from support.graph_rig import following_client
from support.graph_rig import running

SLOW = {'motion': 'continuous', 'profiles': 200, 'profile_rate': 10.0, 'lasers': ['left']}


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


@pytest.fixture(scope='module')
def node(client, cell_file, tmp_path_factory):
    root = tmp_path_factory.mktemp('cell') / 'scans'
    with running('orchestrator', cell=str(cell_file), scan_root=str(root)) as node:
        client.until(lambda: client.status, what='no scan_status')
        yield node


@pytest.fixture
def fake(client, node):
    fake = FakeCell(client)
    client.status.clear()
    yield fake
    fake.fault_of_controller('', 'connected')
    if client.trigger('cancel')[0]:
        result(client)
    fake.close()


def result(client):
    """Return the result of the scan that ends now, and the seconds until it has."""
    begin = time.monotonic()
    found = {}

    def has_ended():
        # the answer of start_scan can overtake the first status
        for status in client.status[-1:]:
            found.update({item.key: item.value for item in status.values})
        return found.get('result')

    client.until(has_ended, 30.0, 'the scan has not ended')
    return json.loads(found['result']), time.monotonic() - begin


def start_sweep(client, fake):
    """Start a scan; return when the table turns with the beam on."""
    assert client.set('orchestrator', **SLOW).successful
    assert client.trigger('start_scan')[0]
    client.until(lambda: fake.seq > 10 and fake.position > 0.3, 30.0, 'no sweep')
    assert fake.beam == 'left'


def test_beam_goes_off_within_a_second_when_the_table_stands(client, fake):
    start_sweep(client, fake)
    fake.stands_from = fake.position
    begin = time.monotonic()
    client.until(lambda: not fake.beam, 3.0, 'the beam shines on')
    assert time.monotonic() - begin < 1.0
    answer, _ = result(client)
    assert answer['code'] == 'MOTION_FAILED'
    assert 'the table stands at' in answer['detail']


@pytest.mark.parametrize(
    'code',
    [
        'CONTROLLER_LOST',
        pytest.param('CONTROLLER_ALARM', marks=pytest.mark.slow),
        pytest.param('POSITION_LOST', marks=pytest.mark.slow),
    ],
)
def test_fault_of_the_controller_ends_the_scan_under_its_code(client, fake, code):
    start_sweep(client, fake)
    # of another cell
    fake.fault_of_controller('CONTROLLER_ALARM', 'motion controller: LOCKED', 'other/turntable')
    client.spin(0.2)
    fake.fault_of_controller(code, f'motion controller: {code}: its cause')
    answer, seconds = result(client)
    assert answer['code'] == code
    assert 'its cause' in answer['detail']
    assert seconds < 2.0


def test_positions_that_contradict_each_other_end_the_scan_with_their_publishers(client, fake):
    start_sweep(client, fake)
    fault = 'joint_states: table positions contradict each other; it is published by /a and /b'
    fake.say_of_triangulator('other/triangulator', table_fault='of another cell')
    client.spin(0.2)
    fake.say_of_triangulator(table_fault=fault)
    answer, seconds = result(client)
    assert answer['code'] == 'JOINT_CONTRADICTORY'
    assert fault in answer['detail']
    assert seconds < 2.0
    fake.say_of_triangulator(table_fault='')
    client.spin(0.2)


def test_laser_that_shines_although_it_is_off_ends_the_scan(client, fake):
    start_sweep(client, fake)
    fault = 'laser left is reported off and shines in the images'
    fake.say_of_triangulator(scan_id='an earlier scan', laser_stuck=fault)
    client.spin(0.2)
    scan_id = {item.key: item.value for item in client.status[-1].values}['scan_id']
    fake.say_of_triangulator(scan_id=scan_id, laser_stuck=fault)
    answer, seconds = result(client)
    assert answer['code'] == 'LASER_STUCK'
    assert fault in answer['detail']
    assert seconds < 2.0


def test_scan_homes_a_table_that_is_locked(client, fake):
    def home(_, response):
        fake.fault_of_controller('', 'connected')
        response.success, response.message = True, '{"code": "OK"}'
        return response

    service = fake.node.create_service(Trigger, 'turntable/home', home)
    fake.fault_of_controller('CONTROLLER_ALARM', 'motion controller: LOCKED')
    client.spin(0.2)
    assert client.set('orchestrator', **SLOW, home=True).successful
    assert client.trigger('start_scan')[0]
    client.until(lambda: fake.seq > 10, 30.0, 'no profiles')
    # from then on an alarm is a fault
    fake.fault_of_controller('CONTROLLER_ALARM', 'motion controller: limit switch')
    answer, seconds = result(client)
    assert (answer['code'], seconds < 2.0) == ('CONTROLLER_ALARM', True)
    client.set('orchestrator', home=False)
    fake.node.destroy_service(service)


def test_node_that_hangs_in_a_parameter_call_is_lost_by_its_heartbeat(client, fake):
    def hang():
        fake.without_heartbeat.add('mesher')
        client.executor.remove_node(fake.nodes['mesher'])

    fake.on_call['registrar/reset'] = hang
    assert client.set('orchestrator', **SLOW).successful
    assert client.trigger('start_scan')[0]
    answer, seconds = result(client)
    assert answer['code'] == 'MESHER_LOST'
    # not the time-out of the call
    assert 'no heartbeat' in answer['detail']
    assert seconds < 4.0


@pytest.mark.parametrize(
    ('profiles', 'tolerance', 'limit'),
    [(3200, 2e-3, 'position_tolerance'), (6300, 1e-4, 'min_step of the triangulator')],
)
def test_steps_that_cannot_be_told_apart_are_refused(client, fake, profiles, tolerance, limit):
    changes = {'motion': 'step', 'profiles': profiles, 'lasers': ['left']}
    assert client.set('orchestrator', **changes, position_tolerance=tolerance).successful
    success, answer = client.trigger('scan', 20.0)
    client.set('orchestrator', position_tolerance=2e-3)
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')
    assert limit in answer['detail']
    assert fake.position == 0.0
