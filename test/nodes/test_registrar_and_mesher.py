# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import contextlib
import json
import signal
import time

from geometry_msgs.msg import PoseArray
import numpy as np
import psutil
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMessage
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from support.graph_rig import running
from visualization_msgs.msg import Marker

from ivfmc_ros import pipeline
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.nodes.camera import camera_info
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.stream import StreamAcquisition


@pytest.fixture(scope='session')
def camera_file(cell, tmp_path_factory):
    path = tmp_path_factory.mktemp('camera') / 'camera.yaml'
    save_camera(path, cell.camera)
    return path


@pytest.fixture(scope='session')
def profiles(cell, frames):
    stream = StreamAcquisition(Acquisition(cell, AcquisitionSettings()))
    found = []
    for seq, frame in enumerate(frames):
        found += stream.add(type(frame)(**{**vars(frame), 'seq': seq, 'stamp_ns': 1000 + seq}))
    return [profile for _, profile in found]


def publish(client, profiles):
    publisher = client.publisher(PointCloud2, 'profile')
    client.until(publisher.get_subscription_count)
    for profile in profiles:
        publisher.publish(clouds.from_profile(profile))
        client.spin(0.0)


def test_live_views_equal_those_of_the_pipeline_and_become_a_mesh(
    client, cell, cell_file, camera_file, profiles, tmp_path
):
    found = client.collect(PointCloud2, 'view')
    placed = client.collect(PoseArray, 'view_poses')
    markers = client.collect(Marker, 'mesh')
    shapes = client.collect(MeshMessage, 'mesh_shape')
    files = {'cell': str(cell_file), 'camera': str(camera_file)}
    root = {'scan_root': str(tmp_path.parent), 'display_triangles': 500}
    with running('registrar', **files), running('mesher', **files, **root):
        client.until(lambda: client.node.count_subscribers('view_poses') == 2)
        assert client.set('mesher', scan_folder=str(tmp_path)).successful
        publish(client, profiles)
        client.until(lambda: f'profiles: {len(profiles)}' in client.diagnostic('registrar'))
        client.until(lambda: placed)
        good, registered = client.trigger('registrar/register')
        assert good, registered
        good, built = client.trigger('mesher/build')
        assert good, built
        client.until(lambda: found[1:] and len(placed) > 1 and markers and shapes)
        again, refused = client.trigger('mesher/build')
        assert not again
        assert refused['code'] == 'BAD_FILE'
        placed_once = len(placed)
        assert client.trigger('registrar/register')[0]
        client.until(lambda: len(placed) > placed_once and len(found) == 4)
        # a mesher must not take the views of before for these
        assert found[3].header.stamp == placed.pop().header.stamp != found[1].header.stamp
        del found[2:]
    expected, _, counts = pipeline.assemble_views(cell, profiles, pipeline.Settings())
    assert registered['counts']['kept_points'] == counts['kept_points']
    assert registered['missing_profiles'] == 0
    for message, view in zip(found, expected, strict=True):
        live = clouds.to_view(message, 'view')
        np.testing.assert_array_equal(live.valid, view.valid)
        np.testing.assert_allclose(live.points_xyz, view.points_xyz, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(live.seqs, view.seqs)
    # the first view was placed as soon as the second one ran
    assert len(placed[0].poses) == 1
    # and cannot be taken for what is final
    assert placed[0].header.stamp != found[0].header.stamp == placed[-1].header.stamp
    assert len(placed[-1].poses) == len(expected)
    assert (tmp_path / 'mesh.stl').stat().st_size == 84 + 50 * built['counts']['faces']
    kinds, loops = built['surface']['faces'], built['surface']['boundary_loops']
    assert sum(kinds.values()) == built['counts']['faces'] > kinds['measured'] > 0
    # the face on which the part stands is not measured
    assert loops >= 1 and built['surface']['longest_loops'][0]['length_m'] > 0.05
    assert len(markers[0].points) == 3 * built['counts']['shown_faces'] <= 1500
    assert len(shapes[0].triangles) == built['counts']['shown_faces']


def test_what_is_missing_is_named(client, cell_file, camera_file, profiles):
    with running('registrar', cell=str(cell_file)), running('mesher', cell=str(cell_file)):
        good, answer = client.trigger('registrar/register')
        assert (good, answer['code']) == (False, 'NO_STRIPE')
        assert '/ivfmc/profile' in answer['detail']
        good, answer = client.trigger('mesher/build')
        assert (good, answer['code']) == (False, 'NOT_READY')
        assert 'view_poses' in answer['detail']
        publish(client, profiles[:3])
        client.until(lambda: 'profiles: 3' in client.diagnostic('registrar'))
        good, answer = client.trigger('registrar/register')
        assert (good, answer['code']) == (False, 'NOT_READY')
        assert 'camera_info' in answer['detail']
        assert client.trigger('registrar/reset') == (True, {'code': 'OK', 'dropped_profiles': 3})


def test_register_waits_for_profiles_that_it_overtakes(client, cell_file, camera_file, profiles):
    files = {'cell': str(cell_file), 'camera': str(camera_file)}
    with running('registrar', **files) as node:
        publisher = client.publisher(PointCloud2, 'profile')
        client.until(publisher.get_subscription_count)
        requests = client.node.create_client(Trigger, 'registrar/register')
        client.until(requests.service_is_ready)
        assert client.set('registrar', expected=len(profiles)).successful
        # as on a machine under load
        node.process.send_signal(signal.SIGSTOP)
        for profile in profiles:
            publisher.publish(clouds.from_profile(profile))
        future = requests.call_async(Trigger.Request())
        client.spin(0.3)
        node.process.send_signal(signal.SIGCONT)
        client.until(future.done)
        answer = json.loads(future.result().message)
        assert answer['code'] == 'OK', answer
        assert answer['counts']['profiles'] == len(profiles)
        assert client.set('registrar', expected=len(profiles) + 1).successful
        good, answer = client.trigger('registrar/register')
        assert (good, answer['code']) == (False, 'PROFILES_LOST')


def test_profiles_beyond_the_maximum_are_refused(client, cell_file, camera_file, profiles):
    files = {'cell': str(cell_file), 'camera': str(camera_file)}
    with running('registrar', **files, most_profiles=len(profiles) - 2):
        publish(client, profiles)
        client.until(lambda: 'refused: 2' in client.diagnostic('registrar'))
        good, answer = client.trigger('registrar/register')
        assert (good, answer['code']) == (False, 'PROFILES_LOST')
        assert 'raise most_profiles' in answer['detail']
        assert client.trigger('registrar/reset')[1]['dropped_profiles'] == len(profiles) - 2
        publish(client, profiles[:-2])
        # the request may overtake them
        assert client.set('registrar', expected=len(profiles) - 2).successful
        good, answer = client.trigger('registrar/register')
        assert good, answer


def test_cloud_with_a_missing_field_is_rejected_by_name(client, cell_file, camera_file, profiles):
    with running('registrar', cell=str(cell_file), camera=str(camera_file)):
        publisher = client.publisher(PointCloud2, 'profile')
        client.until(publisher.get_subscription_count)
        message = clouds.from_profile(profiles[0])
        message.fields = [field for field in message.fields if field.name != 'sigma']
        publisher.publish(message)
        client.until(lambda: "field 'sigma' is missing" in client.diagnostic('registrar'))
        message = clouds.from_profile(profiles[0])
        message.is_bigendian = True
        publisher.publish(message)
        client.until(lambda: 'is big-endian' in client.diagnostic('registrar'))
        publish(client, profiles[:2])
        client.until(lambda: 'big-endian' not in client.diagnostic('registrar'))
        client.until(lambda: 'profiles: 2' in client.diagnostic('registrar'))


@pytest.mark.slow
def test_heartbeat_continues_while_a_mesh_is_built_and_cancelled(
    client, cell_file, camera_file, profiles
):
    files = {'cell': str(cell_file), 'camera': str(camera_file)}
    beats = []
    with running('registrar', **files), running('mesher', **files):
        client.node.create_subscription(
            Header, 'mesher/heartbeat', lambda _: beats.append(time.monotonic()), 100
        )
        client.until(lambda: client.node.count_subscribers('view_poses') == 1)
        publish(client, profiles)
        client.until(lambda: f'profiles: {len(profiles)}' in client.diagnostic('registrar'))
        assert client.trigger('registrar/register')[0]
        requests = client.node.create_client(Trigger, 'mesher/build')
        client.until(requests.service_is_ready)
        # requests of one client keep their order
        future, second = (requests.call_async(Trigger.Request()) for _ in range(2))
        client.until(second.done)
        assert json.loads(second.result().message)['code'] == 'BUSY'
        # as soon as the views are there and the worker has the job
        client.until(lambda: 'views: 2' in client.diagnostic('mesher'))
        assert client.trigger('mesher/cancel')[1]['cancelled']
        client.until(future.done)
        answer = json.loads(future.result().message)
        assert answer['code'] in ('CANCELLED', 'OK')
        assert client.trigger('mesher/build')[0]
    assert max(np.diff(beats)) < 1.0


def request(client, service):
    """Call a Trigger without waiting for its answer; returns a function that does."""
    requests = client.node.create_client(Trigger, service)
    client.until(requests.service_is_ready)
    future = requests.call_async(Trigger.Request())

    def answer():
        client.until(future.done)
        return json.loads(future.result().message)

    return answer


def signal_workers(node, number):
    """Send a signal to the worker processes of a node: a stopped one stays busy."""
    for child in psutil.Process(node.process.pid).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if 'ivfmc_ros.worker' in child.cmdline():
                child.send_signal(number)


def test_new_scan_ends_the_work_for_the_last_one(
    client, cell_file, camera_file, profiles, tmp_path
):
    views = client.collect(PointCloud2, 'view')
    files = {'cell': str(cell_file), 'camera': str(camera_file)}
    root = str(tmp_path.parent)
    with (
        running('registrar', **files) as registrar,
        running('mesher', **files, scan_root=root) as mesher,
    ):
        client.until(lambda: client.node.count_subscribers('view_poses') == 1)
        for scan in ('before', 'now'):
            assert client.set('registrar', scan_id=scan).successful
            publish(client, profiles)
            client.until(lambda: f'profiles: {len(profiles)}' in client.diagnostic('registrar'))
            if scan == 'before':
                signal_workers(registrar, signal.SIGSTOP)
                registered = request(client, 'registrar/register')
                client.until(lambda: 'busy: True' in client.diagnostic('registrar'))
        late = registered()
        signal_workers(registrar, signal.SIGCONT)
        assert late['code'] == 'CANCELLED'
        assert 'scan now was begun' in late['detail']
        assert not views
        good, answer = client.trigger('registrar/register')
        assert good, answer
        assert answer['scan_id'] == 'now'
        # the mesher takes the poses of this answer, and no others
        assert client.set('mesher', scan_id='now', poses_stamp=7).successful
        good, refused = client.trigger('mesher/build')
        assert (good, refused['code']) == (False, 'NOT_READY')
        signal_workers(mesher, signal.SIGSTOP)
        assert client.trigger('registrar/register')[0]
        built = request(client, 'mesher/build')
        # it begins the mesh before it is asked for it: being busy does not tell that it was
        client.spin(1.0)
        client.until(lambda: 'busy: True' in client.diagnostic('mesher'))
        assert client.set('mesher', scan_id='next', scan_folder=str(tmp_path)).successful
        assert built()['code'] == 'CANCELLED'
        signal_workers(mesher, signal.SIGCONT)
        assert not list(tmp_path.iterdir())
        good, refused = client.trigger('mesher/build')
        assert (good, refused['code']) == (False, 'NOT_READY')


def test_invalid_parameters_are_rejected_by_name(client):
    with running('registrar'), running('mesher'):
        for node, name, value in (
            ('registrar', 'registration', 'magic'),
            ('registrar', 'island_least', 0),
            ('mesher', 'mesh.max_edge', float('nan')),
            ('mesher', 'mesh.max_edge', -0.1),
            ('mesher', 'export_unit', 'yard'),
            ('mesher', 'formats', ['step']),
            ('mesher', 'display_triangles', 5),
            ('mesher', 'scan_folder', '/tmp'),
            ('mesher', 'scan_folder', '../elsewhere'),
            ('mesher', 'scan_root', '/tmp'),
            ('registrar', 'scan_root', '/tmp'),
        ):
            answer = client.set(node, **{name: value})
            assert not answer.successful
            assert name.removeprefix('mesh.') in answer.reason


def test_serialized_meshes_are_deserialized_by_rclpy():
    from ivfmc_ros.nodes.convert import meshes

    vertices = np.random.default_rng(1).normal(size=(5, 3))
    faces = np.array([[0, 1, 2], [2, 3, 4]])
    marker = deserialize_message(meshes.marker(vertices, faces, 7), Marker)
    corners = np.array([[point.x, point.y, point.z] for point in marker.points])
    np.testing.assert_array_equal(corners, vertices[faces.ravel()])
    assert marker.header.frame_id == 'turntable'
    assert marker.header.stamp.nanosec == 7
    assert marker.color.a == 1.0
    shape = deserialize_message(meshes.mesh_shape(vertices, faces), MeshMessage)
    assert [list(t.vertex_indices) for t in shape.triangles] == faces.tolist()
    np.testing.assert_array_equal([[v.x, v.y, v.z] for v in shape.vertices], vertices)


def test_camera_info_is_received_once_a_scan_beside_an_orchestrator(client, cell, cell_file):
    infos = client.publisher(CameraInfo, 'camera_info')
    message = camera_info(cell.camera, cell.camera.width, cell.camera.height)

    def count():
        infos.publish(message)
        return infos.get_subscription_count()

    def last(node):
        return 'waiting' not in client.diagnostic(node) and client.diagnostic(node)

    with running('registrar', cell=str(cell_file)), running('mesher', cell=str(cell_file)):
        client.until(lambda: count() == 2 and last('registrar') and last('mesher'))
        # a replay has none, and may bring another camera
        assert count() == 2
        client.publisher(Header, 'orchestrator/heartbeat')
        client.until(lambda: count() == 0)
        for node in ('registrar', 'mesher'):
            assert client.set(node, scan_id='next').successful
        client.until(lambda: infos.get_subscription_count() == 2)
        client.until(lambda: count() == 0)
