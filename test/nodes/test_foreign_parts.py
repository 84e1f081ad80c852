# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What drivers of other packages send and accept, against the code of our nodes."""

import math

from builtin_interfaces.msg import Duration
from builtin_interfaces.msg import Time
import numpy as np
import pytest
from support.foreign_axis import COUNTS
from support.foreign_axis import ForeignAxis
from support.foreign_axis import JOINT
from support.foreign_axis import refusal
from support.foreign_camera import DRIVERS
from support.foreign_camera import image_message
from support.foreign_camera import STAMP_DELAY_S
from support.foreign_scan import ForeignScan
from support.foreign_scan import START_S
from support.synthetic import small_cell
from support.synthetic import Sphere
from trajectory_msgs.msg import JointTrajectory
from trajectory_msgs.msg import JointTrajectoryPoint

from ivfmc_ros.nodes.convert.images import from_image
from ivfmc_ros.nodes.convert.joints import read_trajectory
from ivfmc_ros.storage.matching.frame_matching import SAME_STAMP
from ivfmc_ros.storage.matching.joint_history import joint_in_message

SPHERE = Sphere(np.array([0.012, 0.004, 0.04]), 0.02)
STEPS = 8


def scan(driver, stamp_delay):
    found = ForeignScan(small_cell(), SPHERE, DRIVERS[driver], stamp_delay)
    found.run(STEPS)
    return found


def error(profiles):
    """Greatest distance of a point from the sphere, meters; infinite without points."""
    points = np.concatenate([profile.points_xyz for profile in profiles])
    return float(np.abs(SPHERE.distance(points)).max()) if len(points) else math.inf


@pytest.mark.parametrize('driver', DRIVERS)
def test_scan_has_the_right_shape(driver):
    found = scan(driver, STAMP_DELAY_S[driver])
    assert found.axis.refused == []
    assert len(found.profiles) == 2 * STEPS
    assert all(len(profile) > 30 for profile in found.profiles)
    # the counts of the encoder at the edge of the sphere: 3 um
    assert error(found.profiles) < 1e-5
    assert (SAME_STAMP in found.reasons) == bool(DRIVERS[driver].repeats)


@pytest.mark.parametrize('driver', ['v4l2_camera', 'v4l2_camera_sensor_data'])
def test_stamps_of_the_arrival_would_give_profiles_of_the_other_laser(driver):
    found = scan(driver, 0.0)
    wrong = [profile for profile in found.profiles if not len(profile) or error([profile]) > 1e-3]
    assert wrong


@pytest.mark.parametrize('encoding', ['mono8', 'rgb8', 'yuv422_yuy2'])
def test_images_of_every_encoding_are_read(encoding):
    gray = np.random.default_rng(0).integers(0, 256, (6, 8)).astype(np.uint8)
    image = from_image(image_message(gray, encoding, 0), 'image_raw')
    channels = image if image.ndim == 2 else image[..., 1]
    # 219 steps of luminance for 255 gray values
    assert np.abs(channels.astype(int) - gray).max() <= (1 if encoding == 'yuv422_yuy2' else 0)


def test_other_joints_and_unknown_velocities_are_left_out():
    message = ForeignAxis().joint_states(START_S)
    assert all(math.isnan(velocity) for velocity in message.velocity)
    position, velocity = joint_in_message(message, JOINT)
    assert abs(position) <= 2 * math.pi / COUNTS
    assert velocity is None
    # it has no position
    assert joint_in_message(message, 'gripper_joint') is None


def test_our_commands_are_accepted_and_end_at_their_target():
    found = ForeignScan(small_cell(), SPHERE, DRIVERS['usb_cam'], 0.0)
    found.move(7.5, 2.0)
    assert found.axis.refused == []
    assert found.axis.position_at(START_S + 1.0) == pytest.approx(3.75)
    assert found.axis.position_at(START_S + 2.1) == 7.5


def trajectory(stamp=0, names=(JOINT,), positions=(1.0,), velocities=(0.0,), seconds=1):
    point = JointTrajectoryPoint(
        positions=list(positions),
        velocities=list(velocities),
        time_from_start=Duration(sec=seconds),
    )
    message = JointTrajectory(joint_names=list(names), points=[point])
    message.header.stamp = Time(sec=stamp)
    return message


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({}, ''),
        ({'velocities': ()}, ''),
        ({'names': (), 'positions': ()}, 'not those of the controller'),
        ({'names': (JOINT, 'lift_joint'), 'positions': (1.0, 0.0)}, 'another number'),
        ({'names': (JOINT, 'lift_joint')}, 'another number'),
        ({'names': ('other',)}, 'not those of the controller'),
        ({'velocities': (0.1,)}, 'not zero'),
        ({'stamp': 50, 'seconds': 1}, 'in the past'),
        ({'stamp': 100, 'seconds': 1}, ''),
    ],
)
def test_controller_refuses_what_the_real_one_does(changes, said):
    reason = refusal(trajectory(**changes), 100_000_000_000)
    assert said in reason
    assert bool(said) == bool(reason)


def test_our_driver_takes_what_the_controller_takes():
    assert read_trajectory(trajectory(), JOINT) == (1.0, 1.0)
