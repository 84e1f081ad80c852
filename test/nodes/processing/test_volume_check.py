# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import asyncio

import numpy as np
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.nodes.framework.health import Health
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.processing.volume_check import VolumeCheck
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings

SPHERE = Sphere(np.array([0.004, 0.002, 0.04]), 0.03)


class Node:
    """The parts of a node that the check uses; tasks run at once."""

    def __init__(self):
        self.health = Health(lambda *_: None)
        self.executor = self
        self.searches = 0

    def create_task(self, function, *arguments):
        asyncio.run(function(*arguments))

    async def in_thread(self, function):
        self.searches += 1
        return function()


def acquisition(radius):
    return Acquisition(small_cell(), AcquisitionSettings(volume=Volume(radius=radius)))


def test_volume_that_would_hold_the_part_is_said_in_the_diagnostics():
    node, measured = Node(), acquisition(0.025)
    check = VolumeCheck(node)
    for frame in sphere_frames(small_cell(), SPHERE, 24, seed=1):
        measured.profile(frame)
        check.update(measured)
    level, message = node.health.worst()
    assert level is Level.WARN
    assert 'beyond the radius of the working volume (0.025 m)' in message
    assert 'set radius to at least 0.03' in check.advice
    # again when twice as many images are cut, not for each
    assert node.searches == 4
    check.update(None)
    assert check.advice == ''
    assert node.health.worst()[0] is Level.OK


def test_part_that_fits_is_no_condition():
    node, measured = Node(), acquisition(0.05)
    check = VolumeCheck(node)
    for frame in sphere_frames(small_cell(), SPHERE, 6, seed=1):
        measured.profile(frame)
        check.update(measured)
    assert node.health.worst()[0] is Level.OK
    assert (check.advice, node.searches) == ('', 0)
