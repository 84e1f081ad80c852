# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from contextlib import contextmanager
from contextlib import ExitStack
from dataclasses import replace
import hashlib
import json
import math
import os
from pathlib import Path
import shutil
import signal
import sqlite3

import pytest
from sensor_msgs.msg import Temperature
from std_msgs.msg import UInt64
from support.graph_rig import following_client
from support.graph_rig import running

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

KEYS = {
    'scan_id', 'stage', 'views_done', 'views_total', 'profiles_done', 'profiles_total', 'eta_s',
    'code', 'verdict', 'result', 'report', 'report_error',
}  # fmt: skip


# parameters at the start of every test
PARAMETERS = {
    'motion': 'step',
    'profiles': 3,
    'lasers': [''],
    'exposures': [0.0],
    'velocity': 20.0,
    'acceleration': 200.0,
    'profile_patience': 20.0,
    'lead_time': 0.4,
}


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


@pytest.fixture(scope='module')
def root(tmp_path_factory):
    return tmp_path_factory.mktemp('cell') / 'scans'


@pytest.fixture(scope='module')
def node(client, cell_file, root):
    values = {'cell': str(cell_file), 'scan_root': str(root), 'heartbeat_limit': 1.0}
    with running('orchestrator', **values) as node:
        client.until(lambda: client.status, what='no scan_status')
        yield node


@pytest.fixture
def orchestrator(client, node):
    assert client.set('orchestrator', **PARAMETERS).successful
    client.status.clear()
    yield node
    if client.trigger('cancel')[0]:
        await_stage(client, 'CANCELLED', 'FAILED', 'DONE')


def values_of(client):
    if not client.status:
        return dict.fromkeys(KEYS, '')
    return {item.key: item.value for item in client.status[-1].values}


def listing(root):
    return sorted(path.name for path in root.iterdir()) if root.exists() else []


def await_stage(client, *stages, seconds=30.0):
    client.until(lambda: values_of(client)['stage'] in stages, seconds, f'not {stages}')
    return values_of(client)


def await_report(client, seconds=120.0):
    client.until(
        lambda: values_of(client)['report'] or values_of(client)['report_error'],
        seconds,
        'no report',
    )
    return values_of(client)


def test_step_scan_with_a_foreign_table(client, fake, orchestrator, root):
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert answer['code'] == 'OK'
    assert answer['counts']['profiles'] == 6
    assert answer['registration'] == {'said': 'registrar/register'}
    assert set(answer['files']) >= {'cell.yaml', 'camera.yaml', 'params.yaml', 'mesh.stl',
                                    'report.json', 'job.json'}  # fmt: skip
    # rendered after the answer
    assert answer['report_pending'] is True
    assert 'report.html' not in answer['files']
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
    row = Catalogue(root).scan(answer['scan_id'])
    digest = hashlib.sha256((root / answer['scan_id'] / 'cell.yaml').read_bytes()).hexdigest()
    assert (row.stage, row.calibration) == ('DONE', digest)
    assert scan_folder.load_job(root / answer['scan_id'])['stage'] == 'DONE'
    status = await_report(client)
    assert (status['stage'], status['report_error']) == ('DONE', '')
    assert Path(status['report']).is_file()
    assert (root / answer['scan_id'] / 'mesh.png').is_file()
    assert scan_folder.load_job(root / answer['scan_id'])['report_pending'] is False


def test_continuous_scan_is_one_sweep_a_laser(client, fake, orchestrator):
    # a controller that reports no velocity
    fake.velocities = [math.nan, math.nan]
    client.set('orchestrator', motion='continuous', profiles=12, profile_rate=30.0)
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert answer['counts']['views'] == 2
    assert fake.position > 4 * math.pi


def test_new_scan_does_not_count_profiles_of_the_previous_one(client, fake, orchestrator):
    recorded = client.publisher(UInt64, 'recorded')
    assert client.trigger('start_scan')[0]
    while values_of(client)['stage'] in ('', 'IDLE', 'PREPARING'):
        # as a recorder that has not been started yet
        recorded.publish(UInt64(data=4))
        client.spin(0.02)
    values = [{item.key: item.value for item in status.values} for status in client.status]
    preparing = [v['profiles_done'] for v in values if v['stage'] in ('IDLE', 'PREPARING')]
    assert preparing
    assert set(preparing) == {'0'}


def test_second_scan_is_rejected_with_the_id_of_the_first(client, fake, orchestrator):
    _, first = client.trigger('start_scan')
    success, answer = client.trigger('scan', 2.0)
    assert not success
    assert (answer['code'], answer['scan_id']) == ('BUSY', first['scan_id'])
    client.trigger('cancel')
    await_stage(client, 'CANCELLED')


def test_cancel_ends_the_scan_and_turns_the_laser_off(client, fake, orchestrator, root):
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


def test_pause_turns_the_laser_off_until_resume(client, fake, orchestrator):
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
def test_service_without_a_scan_is_rejected(client, fake, orchestrator, service):
    success, answer = client.trigger(service)
    assert (success, answer['code']) == (False, 'WRONG_STATE')


def test_lost_node_fails_the_scan_with_its_name(client, fake, orchestrator):
    client.set('orchestrator', profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    fake.without_heartbeat.add('registrar')
    status = await_stage(client, 'FAILED', seconds=10.0)
    assert status['code'] == 'REGISTRAR_LOST'
    assert fake.holds[-1][1] == ''
    fake.without_heartbeat.clear()
    client.set('orchestrator', profiles=3)
    assert client.trigger('scan', 60.0)[0]


def test_hung_recorder_ends_the_scan_within_seconds_by_name(client, fake, orchestrator):
    client.set('orchestrator', profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    fake.hanging.add('recorder/stop')
    fake.without_heartbeat.add('recorder')
    assert await_stage(client, 'FAILED', seconds=8.0)['code'] == 'RECORDER_LOST'


def test_bag_that_ends_early_is_not_ok(client, fake, orchestrator):
    fake.responses['recorder/stop'] = {'code': 'OK', 'recorded': 3}
    success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'NOT_RECORDED')
    assert 'ends with profile 3 instead of 5' in answer['detail']


def test_error_of_a_node_keeps_its_code(client, fake, orchestrator):
    fake.responses['registrar/register'] = {'code': 'DEGENERATE', 'detail': 'no surface'}
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
def test_invalid_parameter_is_rejected_by_name(client, orchestrator, name, value):
    result = client.set('orchestrator', **{name: value})
    assert not result.successful
    assert name in result.reason


def test_unknown_laser_is_refused_to_the_caller_that_sets_it(client, fake, orchestrator):
    result = client.set('orchestrator', lasers=['top'])
    assert not result.successful
    assert "lasers: 'top' is not a laser of" in result.reason
    # the next caller's scan is as before
    assert client.trigger('start_scan')[0]


@contextmanager
def locked(root):
    """Lock the catalogue, as another program that has it open does."""
    connection = sqlite3.connect(root / 'catalogue.sqlite3', check_same_thread=False)
    connection.execute('BEGIN EXCLUSIVE')
    yield
    connection.rollback()
    connection.close()


def test_locked_catalogue_rejects_a_scan_and_leaves_no_folder(client, orchestrator, root):
    Catalogue(root, create=True)
    before = listing(root)
    with locked(root):
        success, answer = client.trigger('start_scan')
    assert (success, answer['code']) == (False, 'BAD_CATALOGUE')
    assert listing(root) == before


def test_locked_catalogue_is_reported_and_ends_no_scan(client, fake, orchestrator, root):
    with ExitStack() as stack:
        fake.on_call['registrar/register'] = lambda: stack.enter_context(locked(root))
        success, answer = client.trigger('scan')
    assert success, answer
    assert 'locked' in answer['catalogue_error']
    assert scan_folder.load_job(root / answer['scan_id'])['stage'] == 'DONE'


def test_failed_rendering_is_reported_and_ends_no_scan(client, fake, orchestrator, root):
    def spoil():
        folder = fake.parameter('mesher', 'scan_folder')
        (Path(folder) / 'mesh.stl').write_bytes(b'no mesh')

    fake.on_call['mesher/build'] = spoil
    success, answer = client.trigger('scan')
    assert success, answer
    status = await_report(client)
    assert (status['stage'], status['report']) == ('DONE', '')
    assert 'could not be rendered' in status['report_error']
    job = scan_folder.load_job(root / answer['scan_id'])
    assert (job['report_pending'], job['picture_error']) == (False, status['report_error'])


def test_cancel_ends_the_jobs_of_the_nodes(client, fake, orchestrator):
    fake.hanging.add('registrar/register')
    client.trigger('start_scan')
    await_stage(client, 'REGISTERING')
    # camera, table and triangulator are not needed any more
    fake.without_heartbeat.add('triangulator')
    client.spin(1.5)
    assert values_of(client)['stage'] == 'REGISTERING'
    assert client.trigger('cancel')[0]
    await_stage(client, 'CANCELLED')
    assert fake.called[-2:] == ['registrar/cancel', 'recorder/stop']


def test_temperature_of_a_sensor_is_in_the_answer(client, fake, orchestrator, cell_file):
    sensor = fake.node.create_publisher(Temperature, 'temperature', 1)
    before = cell_file.read_text()
    cell_file.write_text(before + 'temperature_c: 20.0\n')
    fake.on_call['recorder/start'] = lambda: sensor.publish(Temperature(temperature=26.5))
    success, answer = client.trigger('scan')
    cell_file.write_text(before)
    assert success, answer
    measured = answer['temperature']
    assert (measured['mean_c'], measured['u_k'], measured['readings']) == (26.5, 0.5, 1)
    assert 'calibrated at 20 C and has 26.5 C now' in answer['detail']
    assert (Path(answer['folder']) / 'temperature.json').is_file()


@pytest.mark.parametrize(('calibrated', 'said'), [(0.0005, True), (0.004, False)])
def test_exposure_far_from_that_of_the_calibration_is_said(
    client, fake, orchestrator, cell_file, calibrated, said
):
    fake.add_camera('')
    before = cell_file.read_text()
    cell_file.write_text(before + f'exposure: {calibrated}\n')
    success, answer = client.trigger('scan')
    cell_file.write_text(before)
    assert success, answer
    assert ('exposes for 5 ms, in the calibration' in answer.get('detail', '')) == said


def test_focus_that_was_changed_is_said(client, fake, orchestrator):
    doubt = 'laser left: its sheet looks 1.60 times as thick as when it was calibrated'
    fake.on_call['recorder/start'] = lambda: fake.say_of_triangulator(
        scan_id=fake.parameter('registrar', 'scan_id'), focus=doubt
    )
    success, answer = client.trigger('scan')
    assert success, answer
    assert answer['detail'] == doubt


def test_part_that_the_working_volume_cuts_is_said(client, fake, orchestrator):
    advice = 'the surface goes on beyond the radius of the working volume; set radius to 0.072 m'

    def cut():
        scan_id = fake.parameter('registrar', 'scan_id')
        fake.say_of_triangulator(scan_id=scan_id, part_cut=advice)
        # of another cell
        fake.say_of_triangulator('other/triangulator', scan_id=scan_id, part_cut='another')

    fake.on_call['recorder/start'] = cut
    success, answer = client.trigger('scan')
    assert success, answer
    assert answer['detail'] == advice
    assert answer['completeness']['part_cut'] == advice
    # the next scan has another part
    fake.on_call.clear()
    success, answer = client.trigger('scan')
    assert success
    assert answer['completeness']['part_cut'] == ''


def test_mesher_gets_the_working_volume(client, fake, orchestrator):
    assert client.trigger('scan')[0]
    assert fake.parameter('mesher', 'working_radius') == 0.055
    assert fake.parameter('mesher', 'working_top') == 0.09


def test_registrar_gets_the_number_of_profiles(client, fake, orchestrator):
    assert client.trigger('scan')[0]
    assert fake.parameter('registrar', 'expected') == 6


def test_laser_that_is_always_on_ends_with_the_scan(client, fake, orchestrator):
    fake.always_on, fake.recorder_lag = 'left', 2
    client.set('orchestrator', motion='continuous', profiles=12, profile_rate=30.0)
    client.set('orchestrator', lasers=['left'])
    success, answer = client.trigger('scan', 30.0)
    assert success, answer
    seq = fake.seq
    client.spin(0.3)
    assert fake.seq == seq


def test_restarted_triangulator_fails_the_scan(client, fake, orchestrator):
    client.set('orchestrator', profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    fake.seq = 0
    status = await_stage(client, 'FAILED', seconds=10.0)
    assert status['code'] == 'TRIANGULATOR_LOST'
    assert 'was received twice' in status['result']


def test_recording_of_a_dead_orchestrator_is_stopped(client, fake, orchestrator):
    busy = {'code': 'BUSY', 'detail': 'recorder: is recording scans/before'}
    fake.responses['recorder/start'] = [busy, {'code': 'OK'}]
    assert client.trigger('scan')[0]
    assert fake.called[1:4] == ['recorder/start', 'recorder/stop', 'recorder/start']


def test_recorder_that_cannot_write_fails_the_scan_with_its_reason(client, fake, orchestrator):
    fake.recorder_lag = 1_000_000
    full = 'scan.mcap.part: cannot be written: No space left on device'
    fake.responses['recorder/stop'] = {'code': 'BAD_FILE', 'detail': full}
    client.set('orchestrator', profiles=200, profile_patience=1.0)
    success, answer = client.trigger('scan', 30.0)
    assert (success, answer['code']) == (False, 'NOT_RECORDED')
    assert full in answer['detail']


def test_joint_of_another_name_than_in_the_cell_is_rejected(client, orchestrator, cell_file, root):
    other = root.parent / 'other.yaml'
    other.write_text(cell_file.read_text().replace('turntable_joint', 'axis'))
    client.set('orchestrator', cell=str(other))
    success, answer = client.trigger('start_scan')
    client.set('orchestrator', cell=str(cell_file))
    assert (success, answer['code']) == (False, 'BAD_CELL')
    assert 'turntable.joint: is axis' in answer['detail']


def test_camera_that_is_not_calibrated_is_a_bad_cell(client, fake, orchestrator):
    fake.calibrated = False
    success, answer = client.trigger('scan')
    assert (success, answer['code']) == (False, 'BAD_CELL')
    assert 'camera_info' in answer['detail']


# a short lead-in: no sweep begins or ends where the camera stands still
CONTINUOUS = {'motion': 'continuous', 'profiles': 24, 'profile_rate': 20.0, 'lead_time': 0.1}


def test_missing_angles_are_taken_again(client, fake, orchestrator):
    client.set('orchestrator', **CONTINUOUS, lasers=['left'])
    # once: the table turns on in the same direction
    fake.stalls = [(1.0, 3.0)]
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    (view,) = answer['completeness']['views']
    assert view['retaken_as'][0] == 1
    assert view['missing_deg'] == []
    assert answer['completeness']['images']['not_taken'] > 0


def test_angles_that_stay_missing_end_the_scan_as_incomplete(client, fake, orchestrator, root):
    client.set('orchestrator', **CONTINUOUS, lasers=['left'])
    turns = [2.0 * math.pi * turn for turn in range(40)]
    fake.stalls = [(turn + 2.0, turn + 4.0) for turn in turns]
    success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'INCOMPLETE')
    (view,) = answer['completeness']['views']
    ((low, high),) = view['missing_deg']
    assert (low, high) == pytest.approx((114.6, 229.2), abs=25.0)
    assert f'view 0 (laser left): no profiles from {low} to {high} degrees' in answer['detail']
    # what was taken is kept
    assert 'mesh.stl' in answer['files']
    assert fake.called[-2:] == ['mesher/build', 'recorder/stop']
    assert values_of(client)['stage'] == 'FAILED'
    assert scan_folder.load_job(root / answer['scan_id'])['code'] == 'INCOMPLETE'
    report = json.loads((root / answer['scan_id'] / 'report.json').read_text())
    assert report['code'] == 'INCOMPLETE'
    assert report['completeness'] == answer['completeness']


def test_scan_that_does_not_fit_on_the_disk_is_refused(client, fake, orchestrator, root):
    before = listing(root)
    client.set('orchestrator', min_free_space=9e8)
    success, answer = client.trigger('scan')
    client.set('orchestrator', min_free_space=200.0)
    assert (success, answer['code']) == (False, 'DISK_FULL')
    assert 'min_free_space keeps 900000000 MB' in answer['detail']
    assert listing(root) == before


def test_scan_ends_before_the_disk_is_full_and_the_next_one_works(
    client, fake, orchestrator, root, tmp_path
):
    free = shutil.disk_usage(root.parent).free
    if free < 3e9:
        pytest.skip('needs 3 GB of free space')
    client.set('orchestrator', min_free_space=free / 1e6 - 1000.0, profiles=200)
    assert client.trigger('start_scan')[0]
    await_stage(client, 'SCANNING')
    client.until(lambda: fake.beam, 20.0, 'no beam')
    filler = tmp_path / 'filler'
    with filler.open('wb') as stream:
        os.posix_fallocate(stream.fileno(), 0, 2_000_000_000)
    values = await_stage(client, 'FAILED', seconds=5.0)
    filler.unlink()
    assert values['code'] == 'DISK_FULL'
    client.until(lambda: not fake.beam, 2.0, 'the beam is on')
    # the bag was closed in order
    assert fake.called[-1] == 'recorder/stop'
    client.set('orchestrator', min_free_space=200.0, profiles=3)
    success, answer = client.trigger('scan', 60.0)
    assert success, answer


def test_angles_that_the_registrar_dropped_end_the_scan_as_incomplete(client, fake, orchestrator):
    client.set('orchestrator', **CONTINUOUS, lasers=['left'])
    views = [{'view': 0, 'runs': [[-0.1, 2.0]]}]
    fake.responses['registrar/register'] = {'code': 'OK', 'views': views}
    success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'INCOMPLETE')


@pytest.mark.parametrize('motion', ['step', 'continuous'])
@pytest.mark.parametrize('change_s', [-3600.0, -0.5, 3600.0])
def test_clock_that_is_set_fails_the_scan(client, fake, orchestrator, motion, change_s):
    client.set('orchestrator', motion=motion, profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 25, 30.0, 'no profiles')
    fake.clock_change_s = change_s
    status = await_stage(client, 'FAILED', seconds=5.0)
    assert status['code'] == 'CLOCK_JUMPED'
    direction = 'forward' if change_s > 0.0 else 'back'
    assert f'jumped {direction} by' in status['result']
    assert fake.holds[-1][1] == ''


def test_clock_that_is_set_between_scans_is_no_fault(client, fake, orchestrator):
    # ends before the report is rendered, which takes long
    fake.responses['registrar/register'] = {'code': 'DEGENERATE', 'detail': 'no surface'}
    for change_s in (0.0, -3600.0, 3600.0):
        fake.clock_change_s = change_s
        assert client.trigger('scan', 60.0)[1]['code'] == 'DEGENERATE'


def test_orchestrator_that_was_late_itself_loses_no_node(client, fake, orchestrator):
    client.set('orchestrator', profiles=200)
    client.trigger('start_scan')
    client.until(lambda: fake.seq > 2, 30.0, 'no profiles')
    for _ in range(3):
        # heartbeats wait in its queues; the limit is 1 s
        orchestrator.process.send_signal(signal.SIGSTOP)
        client.spin(1.5)
        orchestrator.process.send_signal(signal.SIGCONT)
        seq = fake.seq
        client.until(
            lambda seq=seq: fake.seq > seq or values_of(client)['code'], 10.0, 'no profile'
        )
    assert values_of(client)['stage'] == 'SCANNING'


@contextmanager
def triggered_cell(client, cell, cell_file, folder):
    """Give the orchestrator a cell whose table triggers the camera."""
    path = folder / 'cell.yaml'
    save_cell(path, replace(cell, turntable=replace(cell.turntable, trigger_step=0.15)))
    values = {**CONTINUOUS, 'lasers': ['left'], 'cell': str(path)}
    assert client.set('orchestrator', **values).successful
    try:
        yield
    finally:
        client.set('orchestrator', cell=str(cell_file))


def test_camera_is_triggered_in_a_sweep_and_runs_freely_at_standstill(
    client, fake, orchestrator, cell, cell_file, tmp_path
):
    fake.add_camera('Line1')
    with triggered_cell(client, cell, cell_file, tmp_path):
        success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert fake.triggered == [False, True, False]
    (view,) = answer['completeness']['views']
    # 41 in a turn, though 24 were requested, and the closure
    assert view['planned'] > 41


def test_cancelled_sweep_leaves_the_camera_free(
    client, fake, orchestrator, cell, cell_file, tmp_path
):
    fake.add_camera('Line1')
    with triggered_cell(client, cell, cell_file, tmp_path):
        assert client.trigger('start_scan')[0]
        client.until(lambda: fake.triggered[-1:] == [True], 30.0, 'not triggered')
        assert client.trigger('cancel')[0]
        await_stage(client, 'CANCELLED')
    assert fake.triggered[-1] is False


def test_cell_with_a_trigger_refuses_a_camera_without_a_line(
    client, fake, orchestrator, cell, cell_file, tmp_path
):
    fake.add_camera('')
    with triggered_cell(client, cell, cell_file, tmp_path):
        success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')
    assert 'no trigger line' in answer['detail']


def test_scan_with_several_exposures_leaves_that_of_the_camera(client, fake, orchestrator, root):
    fake.add_camera('')
    client.set('orchestrator', exposures=[0.002, 0.02])
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert answer['counts'] == {**answer['counts'], 'views': 4, 'profiles': 12}
    assert not (root / 'exposures_before_scan.json').exists()
    # tried before the table turns, then one for each sweep, then as it was
    assert fake.exposed == [0.002, 0.02, 0.002, 0.02, 0.005]
    assert fake.parameter('triangulator', 'exposure') == 0.01


def test_cancelled_scan_leaves_the_exposure_of_the_camera(client, fake, orchestrator):
    fake.add_camera('')
    client.set('orchestrator', exposures=[0.02], profiles=50)
    assert client.trigger('start_scan')[0]
    client.until(lambda: len(fake.exposed) == 2, 30.0, 'not exposed')
    assert client.trigger('cancel')[0]
    await_stage(client, 'CANCELLED')
    assert fake.exposed == [0.02, 0.02, 0.005]
    assert fake.parameter('triangulator', 'exposure') == 0.01


def test_exposure_that_the_camera_refuses_ends_the_scan_before_it_moves(
    client, fake, orchestrator
):
    fake.add_camera('')
    before = fake.position
    client.set('orchestrator', exposures=[0.002, 0.2])
    success, answer = client.trigger('scan', 60.0)
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')
    assert 'longer than a period' in answer['detail']
    assert fake.position == before
    assert fake.exposed[-1] == 0.005


def test_exposures_need_a_camera_that_takes_them(client, fake, orchestrator):
    client.set('orchestrator', exposures=[0.002])
    success, answer = client.trigger('scan', 120.0)
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')
    assert 'no parameter exposure' in answer['detail']


@pytest.mark.parametrize('changed', [False, True])
def test_exposure_that_a_killed_orchestrator_left_is_given_back(
    client, fake, orchestrator, root, changed
):
    fake.add_camera('')
    file = root / 'exposures_before_scan.json'
    file.write_text(
        '{"own": {"camera": 0.007, "triangulator": 0.01}, "set": [0.005, 0.02, 0.01, 0.02]}'
    )
    if changed:
        # by a person, after the kill
        client.set('camera', exposure=0.011)
        fake.exposed.clear()
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert fake.exposed == ([] if changed else [0.007])
    assert not file.exists()


def test_damaged_file_of_exposures_ends_no_scan(client, fake, orchestrator, root):
    file = root / 'exposures_before_scan.json'
    file.write_text('{"own": ')
    success, answer = client.trigger('scan', 60.0)
    assert success, answer
    assert not file.exists()


def test_exposures_that_were_left_for_another_camera_end_no_scan(client, fake, orchestrator, root):
    file = root / 'exposures_before_scan.json'
    file.write_text('{"own": {"camera": 0.007, "triangulator": 0.01}, "set": [0.002]}')
    success, answer = client.trigger('scan', 120.0)
    assert success, answer
    assert not file.exists()
