# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.surfaces import block

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.pose_evidence import Skin
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.surfels import fit_patches

EDGE, NOISE = 8e-4, 5e-5


@pytest.fixture(scope='module')
def skin():
    """A wavy surface seen from above."""
    patches = fit_patches(sample(block(), EDGE), EDGE)
    up = np.sign(patches.normals[:, 2:])
    patches = type(patches)(**{**vars(patches), 'normals': patches.normals * up})
    sight = np.tile([0.0, 0.6, 0.8], (len(patches), 1))
    return Skin(Body(name='block', patches=patches, sight=sight), EDGE)


def lifted(height):
    return transforms.rigid(np.eye(3), (0.0, 0.0, height))


def test_a_surface_agrees_with_itself(skin):
    found = skin.evidence(skin, np.eye(4), NOISE)
    assert found.agree > 0.98
    assert found.against < 0.005


def test_a_surface_a_little_beside_differs(skin):
    found = skin.evidence(skin, lifted(5e-4), NOISE)
    assert found.agree < 0.02
    assert found.differ > 0.9
    assert found.worse_than(skin.evidence(skin, np.eye(4), NOISE)) > 10.0


def test_what_lies_under_another_surface_was_not_seen(skin):
    found = skin.evidence(skin, lifted(0.01), NOISE)
    assert found.agree == 0.0
    # the lower one; near its border sight passes by
    assert 0.3 < found.blocked < 0.55


def test_bodies_apart_say_nothing_about_each_other(skin):
    found = skin.evidence(skin, transforms.rigid(np.eye(3), (0.2, 0.0, 0.0)), NOISE)
    assert (found.agree, found.against) == (0.0, 0.0)
    assert found.worse_than(found) == 0.0
