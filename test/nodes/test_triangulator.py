# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_msgs.msg import String
from support.cell_inputs import START
from support.cell_inputs import STEP
from support.graph_rig import running

from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.urdf import urdf
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert.stamps import header


def feed(inputs, frames, first=0, found=None):
    before = len(found) if found is not None else 0
    for number, frame in enumerate(frames, start=first):
        inputs.step(number, frame)
        if found is not None:
            # the publisher queues 30; 16 wait until the automatic settings are determined
            inputs.client.until(lambda sent=number - first: len(found) - before > sent - 20)
        else:
            inputs.client.spin(0.01)


def test_every_image_becomes_a_profile_of_the_sphere(client, inputs, cell_file, frames, sphere):
    found = client.collect(PointCloud2, 'profile')
    shown = client.collect(CompressedImage, 'stripe_image/compressed')
    with running('triangulator', cell=str(cell_file), scan_id='first'):
        inputs.wait()
        feed(inputs, frames, found=found)
        # the last one is exposed after the last states; it is matched after the time-out
        client.until(lambda: len(found) == len(frames))
        client.until(lambda: shown)
    profiles = [clouds.to_profile(message, 'profile') for message in found]
    assert [profile.seq for profile in profiles] == list(range(len(frames)))
    assert [profile.laser for profile in profiles] == [frame.laser for frame in frames]
    assert [profile.view for profile in profiles] == [frame.laser for frame in frames]
    assert [profile.stamp_ns for profile in profiles] == [
        START + number * STEP for number in range(len(frames))
    ]
    points = np.concatenate([profile.points_xyz for profile in profiles])
    assert np.sqrt(np.mean(sphere.distance(points) ** 2)) < 1e-4


def test_description_of_the_cell_is_latched(client, cell_file):
    with running('triangulator', cell=str(cell_file)):
        client.until(lambda: 'tf: ' in client.diagnostic('triangulator'))
        # a subscription that is later than the message
        found = client.collect(String, 'robot_description')
        client.until(lambda: found)
    assert [message.data for message in found] == [urdf(load_draft(cell_file))]


def test_laser_that_shines_although_it_is_off_is_reported(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    last = replace(frames[19], laser=-1)
    dark = replace(last, image=np.zeros_like(last.image))
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        feed(inputs, frames[:20], found=found)
        feed(inputs, [last] * 12, first=20)
        client.until(lambda: 'shines in the images' in client.diagnostic('triangulator'))
        feed(inputs, [dark] * 2, first=32)
        client.until(lambda: 'shines in the images' not in client.diagnostic('triangulator'))
        # diagnostics may be faster than the last profiles
        client.until(lambda: len(found) >= 20)
        client.spin(0.5)
        # no image with the lasers off is a profile
        assert len(found) == 20


def test_changed_settings_lose_no_image_that_waits_for_its_settings(
    client, inputs, cell_file, frames
):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file), patience=0.1):
        inputs.wait()
        feed(inputs, frames[:5])
        client.until(lambda: '5 pictures' in client.diagnostic('triangulator'))
        client.until(lambda: 'waiting: 0' in client.diagnostic('triangulator'))
        assert client.set('triangulator', extract__min_snr=6.0).successful
        feed(inputs, frames[5:8], first=5)
        client.until(lambda: len(found) == 8)
    assert [clouds.to_profile(item, 'profile').seq for item in found] == list(range(8))


def test_missing_joint_states_are_reported_until_the_first_is_received(
    client, inputs, cell_file, frames
):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file), queue=5, patience=2.0):
        inputs.wait()
        inputs.camera_info()
        for number, frame in enumerate(frames[:8]):
            inputs.picture(frame.image, START + number * STEP)
            client.spin(0.02)
        client.until(lambda: 'joint_states: waiting' in client.diagnostic('triangulator'))
        client.until(lambda: '3 waited too long' in client.diagnostic('triangulator'))
        assert found == []
        feed(inputs, frames[8:12], first=8)
        client.until(lambda: 'joint_states: waiting' not in client.diagnostic('triangulator'))
        client.until(lambda: found)


def test_camera_info_of_another_image_size_is_reported(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        inputs.camera_info(width=320, height=256, k=[600.0, 0, 160, 0, 600, 128, 0, 0, 1])
        for number, frame in enumerate(frames[:3]):
            stamp = START + number * STEP
            inputs.table(frame.angle, stamp)
            inputs.lit(0, stamp)
            inputs.lit(0, stamp + STEP)
            inputs.picture(frame.image, stamp)
        wrong = 'the picture is 640 x 512, the camera was calibrated at 320 x 256'
        client.until(lambda: wrong in client.diagnostic('triangulator'))
        assert found == []
        feed(inputs, frames[:20], first=5, found=found)
        client.until(lambda: len(found) >= 16)
        client.until(lambda: wrong not in client.diagnostic('triangulator'))


def test_uncalibrated_camera_info_is_reported(client, inputs, cell_file):
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        inputs.camera_info(k=[0.0] * 9)
        client.until(lambda: 'camera_matrix' in client.diagnostic('triangulator'))


def test_images_lost_before_the_triangulator_are_counted(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        for number, frame in enumerate([*frames, *frames[:4]]):
            stamp = START + number * STEP
            if number in (20, 21, 30):
                inputs.camera_info(stamp)
                inputs.table(frame.angle, stamp)
                continue
            inputs.step(number, frame)
            client.until(lambda sent=number: len(found) > sent - 23)
        client.until(lambda: 'images_not_received: 3' in client.diagnostic('triangulator'))


def test_stamps_that_jump_back_discard_the_states_before(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        feed(inputs, frames[:20], found=found)
        client.until(lambda: len(found) >= 19)
        feed(inputs, frames[:20], found=found)
        client.until(lambda: len(found) >= 39)
        client.until(lambda: 'jumps' in client.diagnostic('triangulator'))
    assert [clouds.to_profile(message, '').seq for message in found] == list(range(len(found)))


def test_joints_of_other_names_are_reported_while_ours_is_missing(client, inputs, cell_file):
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        inputs.table(0.0, START, name='elbow')
        wrong = "waiting for position of joint 'turntable_joint'; last message has joints: elbow"
        client.until(lambda: wrong in client.diagnostic('triangulator'))


def test_foreign_joint_states_are_logged_once_whatever_they_contain(client, inputs, cell_file):
    with running('triangulator', cell=str(cell_file)) as node:
        inputs.wait()
        client.until(lambda: 'joint_states: waiting' in client.diagnostic('triangulator'))
        for number in range(200):
            inputs.table(0.001 * number, START + number * STEP, name='elbow')
            client.spin(0.012)
        client.until(lambda: 'elbow 0.199' in client.diagnostic('triangulator'))
    lines = [line for line in node.output.splitlines() if 'joint_states' in line]
    assert len(lines) == 1, lines


def test_foreign_joint_states_beside_ours_are_no_condition(client, inputs, cell_file):
    with running('triangulator', cell=str(cell_file)) as node:
        inputs.wait()
        inputs.table(0.0, START)
        for number in range(200):
            inputs.table(0.001 * number, START + number * STEP, name='elbow')
            inputs.table(0.001 * number, START + number * STEP)
            client.spin(0.012)
        client.until(lambda: 'joint_states' not in client.diagnostic('triangulator'))
    lines = [line for line in node.output.splitlines() if 'joint_states' in line]
    # at most that they were not received yet, and that they were
    assert len(lines) <= 2
    assert not any('WARN' in line or 'ERROR' in line for line in lines)


def test_two_publishers_of_the_joint_are_named(client, inputs, cell_file):
    other = Node('state_publisher', namespace='/robot', context=client.context)
    joints = other.create_publisher(JointState, '/ivfmc/joint_states', 10)
    try:
        with running('triangulator', cell=str(cell_file)) as node:
            inputs.wait()
            for number in range(60):
                inputs.table(0.05 * number, START + number * STEP // 4)
                stamp = header(START + number * STEP // 4 + STEP // 8, '')
                # the part of a robot model that does not move
                joints.publish(JointState(header=stamp, name=['turntable_joint'], position=[0.0]))
                client.spin(0.02)
            client.until(lambda: 'contradict each other' in client.diagnostic('triangulator'))
            text = client.diagnostic('triangulator')
            assert '/robot/state_publisher' in text
            assert '/ivfmc/client' in text
        assert sum('contradict' in line for line in node.output.splitlines()) == 1
    finally:
        other.destroy_node()


def test_joint_without_a_position_is_reported_until_it_is_homed(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        inputs.table(float('nan'), START - STEP)
        client.until(
            lambda: (
                'last message has joints: turntable_joint nan' in client.diagnostic('triangulator')
            )
        )
        feed(inputs, frames[:20], found=found)
        client.until(lambda: len(found) >= 16)
        inputs.picture(frames[0].image, START + 36_000 * STEP)
        client.until(lambda: 'ahead of those of' in client.diagnostic('triangulator'))
        feed(inputs, frames[20:24], first=20)
        client.until(lambda: 'ahead of those of' not in client.diagnostic('triangulator'))


def test_modified_cell_file_is_used_from_the_next_scan(
    client, inputs, cell, cell_file, frames, tmp_path
):
    found = client.collect(PointCloud2, 'profile')
    path = tmp_path / 'cell.yaml'
    path.write_text(cell_file.read_text())
    with running('triangulator', cell=str(path)):
        inputs.wait()
        lasers = tuple(replace(laser, name=f'new_{laser.name}') for laser in cell.lasers)
        inputs.cell = replace(cell, lasers=lasers)
        save_cell(path, inputs.cell)
        assert client.set('triangulator', scan_id='another').successful
        feed(inputs, frames[:20], found=found)
        client.until(lambda: len(found) >= 16)


def test_missing_cell_file_is_reported_until_another_is_set(client, tmp_path, cell_file):
    with running('triangulator', cell=str(tmp_path / 'none.yaml')):
        client.until(lambda: 'none.yaml' in client.diagnostic('triangulator'))
        assert client.set('triangulator', cell=str(cell_file)).successful
        client.until(lambda: 'none.yaml' not in client.diagnostic('triangulator'))


def test_invalid_parameters_are_rejected_by_name(client, cell_file, tmp_path):
    with running('triangulator', cell=str(cell_file)):
        for name, value in (
            ('exposure', float('nan')),
            ('exposure', 11.0),
            ('patience', -1.0),
            ('motion', 'hop'),
            ('volume__top', -0.5),
            ('extract__smoothing', 4),
            ('extract__channel', 'pink'),
            ('noise_distance', float('inf')),
            ('view', [-2, 0]),
            ('cell', str(tmp_path / 'none.yaml')),
        ):
            answer = client.set('triangulator', **{name: value})
            assert not answer.successful
            key = name.replace('__', '.').split('.')[-1]
            assert key in answer.reason or 'none.yaml' in answer.reason
        assert client.set('triangulator', view=[0, 1], motion='step').successful
        # a dark frame belongs to one exposure
        assert client.set('triangulator', exposures=3).successful
        answer = client.set('triangulator', subtract_dark=True)
        assert not answer.successful
        assert 'exposures' in answer.reason


def test_step_motion_measures_each_standstill_once(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file), motion='step', settle=0.05):
        inputs.wait()
        inputs.camera_info()
        tick = 10_000_000
        # stands at 0 for 0.3 s, turns for 0.3 s, stands at 0.3 rad for 0.3 s
        for count in range(91):
            stamp = START + count * tick
            inputs.table(min(max(count - 30, 0), 30) * 0.01, stamp)
            inputs.lit(0, stamp)
            if count % 10 == 5:
                inputs.picture(frames[0].image, stamp)
            client.spin(0.0)
        client.until(lambda: len(found) == 2)
        client.until(lambda: '3 table moving' in client.diagnostic('triangulator'))
        client.until(lambda: 'angle measured already' in client.diagnostic('triangulator'))
    angles = [clouds.to_profile(message, '').angle for message in found]
    np.testing.assert_allclose(angles, [0.0, 0.3], atol=1e-6)


def test_laser_without_a_view_number_gives_no_profile(client, inputs, cell_file, frames):
    found = client.collect(PointCloud2, 'profile')
    with running('triangulator', cell=str(cell_file), view=[-1, 7]):
        inputs.wait()
        feed(inputs, [*frames[:5], *frames[-17:]])
        client.until(lambda: len(found) == 17)
    assert {clouds.to_profile(message, '').view for message in found} == {7}


@pytest.mark.slow
def test_no_images_are_received_while_all_lasers_are_off_for_long(
    client, inputs, cell_file, frames
):
    found = client.collect(PointCloud2, 'profile')
    # it rests beside an orchestrator only
    beats = client.publisher(Header, 'orchestrator/heartbeat')
    with running('triangulator', cell=str(cell_file)):
        inputs.wait()
        feed(inputs, frames[:20], found=found)
        client.until(lambda: len(found) >= 16)
        stamp = START + 20 * STEP
        inputs.lit(None, stamp)
        client.until(lambda: client.node.count_subscribers('image_raw') == 0, 30.0)
        assert 'image_raw: waiting' not in client.diagnostic('triangulator')
        # a laser that goes on wakes it
        before = len(found)
        inputs.lit(0, stamp + STEP)
        client.until(lambda: client.node.count_subscribers('image_raw') == 1)
        feed(inputs, frames[22:26], first=22)
        client.until(lambda: len(found) > before)
        # and so does a parameter, such as the view of the next sweep
        inputs.lit(None, stamp + 10 * STEP)
        client.until(lambda: client.node.count_subscribers('image_raw') == 0, 30.0)
        assert client.set('triangulator', view=[3, 4]).successful
        client.until(lambda: client.node.count_subscribers('image_raw') == 1)
    client.node.destroy_publisher(beats)
