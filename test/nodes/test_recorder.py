# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import sqlite3

import numpy as np
import pytest
from sensor_msgs.msg import Image
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_msgs.msg import UInt64
from std_srvs.srv import Trigger
from support.graph_rig import Client
from support.graph_rig import running

from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.scans.stored_scan import read_profiles

START = 1_790_000_000_000_000_000


@pytest.fixture(scope='module')
def client():
    client = Client()
    yield client
    client.close()


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    with running('recorder', scan_root=str(tmp_path_factory.getbasetemp())) as node:
        yield node


@pytest.fixture
def recorder(client, node):
    yield node
    # a recording that a test left running
    client.trigger('recorder/stop')


@pytest.fixture
def scan(client, recorder, tmp_path):
    """Folder of a scan that is set in the recorder."""
    Catalogue(tmp_path, create=True).add_scan('s1', 'part', '', 'SCANNING', {})
    (tmp_path / 's1').mkdir()
    client.set('recorder', scan_id='s1', scan_folder=str(tmp_path / 's1'))
    return tmp_path / 's1'


def profile(seq, points=5):
    return clouds.from_profile(
        Profile(
            points_xyz=np.arange(3.0 * points).reshape(-1, 3),
            intensity=np.zeros(points),
            sigma=np.zeros(points),
            uv=np.zeros((points, 2)),
            angle=0.1 * seq,
            laser=0,
            view=0,
            seq=seq,
            stamp_ns=START + seq,
        )
    )


def ready(client, *publishers):
    client.until(lambda: all(p.get_subscription_count() for p in publishers), what='no recorder')


def test_what_is_published_is_in_the_bag_and_the_catalogue(client, scan, tmp_path):
    profiles = client.publisher(PointCloud2, 'profile')
    images = client.publisher(Image, 'image_raw')
    # a foreign driver, best effort
    joints = client.publisher(JointState, 'joint_states', qos.best_effort(10))
    recorded = client.collect(UInt64, 'recorded')
    success, answer = client.trigger('recorder/start')
    assert success, answer
    ready(client, profiles, images, joints)
    client.spin(0.6)  # the recorder adapts to the QoS of the publishers
    for seq in range(5):
        images.publish(Image(height=2, width=3, step=3, encoding='mono8', data=bytes(6)))
        joints.publish(JointState(name=['turntable_joint'], position=[0.1 * seq]))
        profiles.publish(profile(seq, points=0 if seq == 4 else 5))
    client.until(lambda: recorded and recorded[-1].data == 4, what='not recorded')
    # flushed messages can be read during the scan
    assert open_bag(scan / 'scan.mcap.part', salvage=True).topics['/ivfmc/profile'].count == 5
    success, answer = client.trigger('recorder/stop')
    assert success, answer
    assert (answer['recorded'], answer['dropped']) == (4, 0)
    bag = open_bag(scan)
    assert {name: topic.count for name, topic in bag.topics.items()} == {
        '/ivfmc/image_raw': 5,
        '/ivfmc/joint_states': 5,
        '/ivfmc/profile': 5,
    }
    (view,) = Catalogue(tmp_path).views('s1')
    assert (view.profiles, view.points) == (5, 20)
    stored = list(read_profiles(Catalogue(tmp_path), 's1'))
    assert [len(one) for one in stored] == [5, 5, 5, 5, 0]


def test_locked_catalogue_delays_no_message_and_loses_no_row(client, scan, tmp_path):
    profiles = client.publisher(PointCloud2, 'profile')
    recorded = client.collect(UInt64, 'recorded')
    ready(client, profiles)
    client.spin(0.6)
    assert client.trigger('recorder/start')[0]
    connection = sqlite3.connect(tmp_path / 'catalogue.sqlite3')
    connection.execute('BEGIN EXCLUSIVE')
    for seq in range(3):
        profiles.publish(profile(seq))
        client.until(lambda seq=seq: recorded and recorded[-1].data == seq, 3.0, 'not recorded')
    connection.rollback()
    connection.close()
    success, answer = client.trigger('recorder/stop')
    assert success, answer
    assert answer['catalogue_error'] == ''
    assert [row.seq for row in Catalogue(tmp_path).profiles('s1')] == [0, 1, 2]


def test_nothing_is_written_before_start_and_after_stop(client, scan):
    joints = client.publisher(JointState, 'joint_states')
    client.spin(0.6)
    joints.publish(JointState(name=['a'], position=[0.0]))
    client.spin(0.3)
    client.trigger('recorder/start')
    client.trigger('recorder/stop')
    joints.publish(JointState(name=['a'], position=[0.0]))
    client.spin(0.3)
    assert open_bag(scan).message_count == 0


def test_start_without_a_folder_is_refused(client, recorder):
    client.set('recorder', scan_id='', scan_folder='')
    success, answer = client.trigger('recorder/start')
    assert (success, answer['code']) == (False, 'BAD_PARAMETER')


@pytest.mark.parametrize('folder', ['/tmp/elsewhere', '../elsewhere', '.'])
def test_folder_outside_of_the_scan_root_is_refused(client, recorder, folder):
    answer = client.set('recorder', scan_folder=folder)
    assert not answer.successful
    assert 'is not below' in answer.reason
    assert 'scan_root' in answer.reason


def test_second_start_is_refused(client, scan):
    assert client.trigger('recorder/start')[0]
    success, answer = client.trigger('recorder/start')
    assert (success, answer['code']) == (False, 'BUSY')


def test_bag_is_not_overwritten(client, scan):
    assert client.trigger('recorder/start')[0]
    assert client.trigger('recorder/stop')[0]
    success, answer = client.trigger('recorder/start')
    assert (success, answer['code']) == (False, 'BAD_FILE')
    success, answer = client.trigger('recorder/stop')
    assert (success, answer['code']) == (False, 'WRONG_STATE')


def test_profile_without_its_fields_is_reported_by_name(client, scan):
    profiles = client.publisher(PointCloud2, 'profile')
    ready(client, profiles)
    client.trigger('recorder/start')
    message = profile(0)
    message.fields = [field for field in message.fields if field.name != 'seq']
    profiles.publish(message)
    client.until(lambda: "'seq'" in client.diagnostic('recorder'), what='no diagnostic')


def test_recording_of_an_orchestrator_that_died_is_stopped(client, scan):
    profiles = client.publisher(PointCloud2, 'profile')
    beats = client.publisher(Header, 'orchestrator/heartbeat')
    ready(client, profiles, beats)
    client.set('recorder', orchestrator_patience=1.0)
    try:
        assert client.trigger('recorder/start')[0]
        profiles.publish(profile(0))
        for _ in range(20):
            beats.publish(Header(frame_id='orchestrator'))
            client.spin(0.1)
        # no time-out while heartbeats are received
        assert not (scan / 'scan.mcap').exists()
        client.until((scan / 'scan.mcap').exists, 10.0, 'the bag was not finished')
        client.until(
            lambda: 'orchestrator: no heartbeat: no heartbeat for' in client.diagnostic('recorder')
        )
        assert [p.seq for p in read_profiles(Catalogue(scan.parent), 's1')] == [0]
        assert client.trigger('recorder/stop')[1]['code'] == 'WRONG_STATE'
    finally:
        client.set('recorder', orchestrator_patience=30.0)


def test_recording_without_an_orchestrator_continues(client, scan):
    client.set('recorder', orchestrator_patience=0.5)
    try:
        assert client.trigger('recorder/start')[0]
        client.spin(2.0)
        assert client.trigger('recorder/stop')[0]
    finally:
        client.set('recorder', orchestrator_patience=30.0)


def test_new_recording_keeps_its_rows_while_the_last_one_closes(client, scan, tmp_path):
    profiles = client.publisher(PointCloud2, 'profile')
    recorded = client.collect(UInt64, 'recorded')
    ready(client, profiles)
    assert client.trigger('recorder/start')[0]
    for seq in range(3):
        profiles.publish(profile(seq))
    client.until(lambda: recorded and recorded[-1].data == 2, what='not recorded')
    Catalogue(tmp_path).add_scan('s2', 'part', '', 'SCANNING', {})
    (tmp_path / 's2').mkdir()
    # the last one cannot close: the catalogue is locked
    connection = sqlite3.connect(tmp_path / 'catalogue.sqlite3')
    connection.execute('BEGIN EXCLUSIVE')
    profiles.publish(profile(3))
    stop = client.node.create_client(Trigger, 'recorder/stop')
    client.until(stop.service_is_ready)
    stopped = stop.call_async(Trigger.Request())
    client.until(lambda: 'closing: 1' in client.diagnostic('recorder'))
    connection.rollback()
    connection.close()
    client.set('recorder', scan_id='s2', scan_folder=str(tmp_path / 's2'))
    assert client.trigger('recorder/start')[0]
    del recorded[:]
    client.until(stopped.done)
    assert json.loads(stopped.result().message)['scan_id'] == 's1'
    for seq in range(2):
        profiles.publish(profile(seq))
    client.until(lambda: recorded and recorded[-1].data == 1, what='not recorded')
    # ``recorded`` is of the running scan only
    assert all(message.data <= 1 for message in recorded)
    success, answer = client.trigger('recorder/stop')
    assert success, answer
    assert answer['scan_id'] == 's2'
    assert [row.seq for row in Catalogue(tmp_path).profiles('s2')] == [0, 1]
    assert [row.seq for row in Catalogue(tmp_path).profiles('s1')] == [0, 1, 2, 3]


def test_recording_ends_when_another_orchestrator_takes_over(client, scan):
    beats = client.publisher(Header, 'orchestrator/heartbeat')
    ready(client, beats)
    client.set('recorder', owner='first')
    try:
        assert client.trigger('recorder/start')[0]
        for life in ('first', 'second'):
            beats.publish(Header(frame_id=f'orchestrator/{life}/9.0'))
            client.spin(0.1)
        assert not (scan / 'scan.mcap').exists()

        def ended():
            beats.publish(Header(frame_id='orchestrator/second/9.0'))
            return (scan / 'scan.mcap').exists()

        client.until(ended, 10.0, 'the bag was not finished')
        client.until(lambda: 'the orchestrator was restarted' in client.diagnostic('recorder'))
    finally:
        client.set('recorder', owner='')


def test_streams_are_subscribed_only_while_they_are_recorded(client, scan):
    def subscribers(*names):
        return [client.node.count_subscribers(name) for name in names]

    streams = ('image_raw', 'camera_info', 'joint_states')
    # the profile and what is latched are subscribed at all times
    client.until(lambda: all(subscribers('profile', 'laser_states', 'mesh')))
    client.until(lambda: subscribers(*streams) == [0, 0, 0])
    assert client.trigger('recorder/start')[0]
    client.until(lambda: subscribers(*streams) == [1, 1, 1])
    client.set('recorder', pictures=False)
    client.until(lambda: subscribers(*streams) == [0, 0, 1])
    client.set('recorder', pictures=True)
    client.until(lambda: subscribers(*streams) == [1, 1, 1])
    assert client.trigger('recorder/stop')[0]
    client.until(lambda: subscribers(*streams) == [0, 0, 0])


def test_first_messages_after_the_start_are_in_the_bag(client, scan):
    joints = client.publisher(JointState, 'joint_states')
    assert client.trigger('recorder/start')[0]
    for number in range(20):
        joints.publish(JointState(name=['turntable_joint'], position=[0.1 * number]))
        client.spin(0.01)
    assert client.trigger('recorder/stop')[0]
    assert open_bag(scan).topics['/ivfmc/joint_states'].count == 20
    client.node.destroy_publisher(joints)
