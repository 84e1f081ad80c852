# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.surfaces import wavy_view

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.pose_evidence import SurfaceIndex
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.surfels import fit_surfels

EDGE, NOISE = 8e-4, 5e-5


@pytest.fixture(scope='module')
def index():
    """A wavy surface seen from above."""
    surfels = fit_surfels(downsample(wavy_view(), EDGE), EDGE)
    up = np.sign(surfels.normals[:, 2:])
    surfels = type(surfels)(**{**vars(surfels), 'normals': surfels.normals * up})
    sight = np.tile([0.0, 0.6, 0.8], (len(surfels), 1))
    return SurfaceIndex(ClampedSurface(name='wavy_view', surfels=surfels, sight=sight), EDGE)


def lifted(height):
    return transforms.rigid(np.eye(3), (0.0, 0.0, height))


def test_surface_agrees_with_itself(index):
    found = index.evidence(index, np.eye(4), NOISE)
    assert found.agree > 0.98
    assert found.against < 0.005


def test_surface_at_a_small_distance_differs(index):
    found = index.evidence(index, lifted(5e-4), NOISE)
    assert found.agree < 0.02
    assert found.differ > 0.9
    assert found.worse_than(index.evidence(index, np.eye(4), NOISE)) > 10.0


def test_surface_under_another_one_is_blocked(index):
    found = index.evidence(index, lifted(0.01), NOISE)
    assert found.agree == 0.0
    # the lower one; near its border sight passes by
    assert 0.3 < found.blocked < 0.55


def test_surfaces_apart_give_no_evidence(index):
    found = index.evidence(index, transforms.rigid(np.eye(3), (0.2, 0.0, 0.0)), NOISE)
    assert (found.agree, found.against) == (0.0, 0.0)
    assert found.worse_than(found) == 0.0
