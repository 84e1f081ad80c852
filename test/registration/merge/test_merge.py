# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.clampings import clamped
from support.clampings import displacement
from support.clampings import lying
from support.surfaces import empty

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import AmbiguousError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.registration.merge.merge import merge
from ivfmc_ros.registration.merge.merge import require_one_cell
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.parts.solids import demo_part

CELL = bench_cell()
SIDE = 0
# six, on a circle
BOLTS = [(np.cos(a), np.sin(a)) for a in np.radians(range(30, 360, 60))]
LYING = lying(demo_part(), SIDE)


@pytest.fixture(scope='module')
def upright():
    return clamped('upright', CELL, demo_part(), np.eye(4), 100)


@pytest.fixture(scope='module')
def on_its_side():
    return clamped('lying', CELL, demo_part(), LYING, 100, seed=2)


def both(part, steps=60, seed=0):
    return [
        clamped('upright', CELL, part, np.eye(4), steps),
        clamped('lying', CELL, part, lying(part, seed), steps, seed=2),
    ]


def test_two_clampings_are_merged_without_an_initial_pose(upright, on_its_side):
    # the second one's views were displaced, and its own registration found that
    slip = transforms.rigid(transforms.rotation_z(0.3), (0.004, -0.002, 0.0))
    views = [
        replace(view, points_xyz=transforms.apply(transforms.invert(slip), view.points_xyz))
        for view in on_its_side.views
    ]
    poses = replace(on_its_side.poses, turntable_from_view=np.stack([slip] * len(views)))
    merged = merge([upright, replace(on_its_side, views=views, poses=poses)])
    found = merged.first_from_clamping[1] @ LYING
    assert displacement(demo_part(), found, np.eye(4)) < 1e-4
    np.testing.assert_array_equal(merged.first_from_clamping[0], np.eye(4))
    assert [view.number for view in merged.views] == [0, 1, 2, 3]
    assert [view.clamping for view in merged.views] == [0, 0, 1, 1]
    np.testing.assert_allclose(
        merged.poses.turntable_from_view[3], merged.first_from_clamping[1] @ slip, atol=1e-12
    )
    placing = merged.placings[1]
    assert placing.onto == ('upright',)
    assert placing.agree > 12 * (placing.differ + placing.blocked)
    assert 0.3 < placing.overlap < 0.9
    assert placing.sigma < 5e-5


@pytest.mark.slow
def test_poses_that_a_symmetric_part_does_not_distinguish_are_named():
    with pytest.raises(AmbiguousError, match='lying fits on upright in 4 ways') as refused:
        merge(both(box((0.044, 0.030, 0.060))))
    motions = ' '.join(refused.value.values['motions'])
    assert motions.count('180.0 degrees') == 3
    for axis in ('(1.00, 0.00, 0.00)', '(0.00, 1.00, 0.00)', '(0.00, 0.00, 1.00)'):
        assert axis in motions


@pytest.mark.slow
def test_turn_that_a_round_part_does_not_constrain_is_named():
    with pytest.raises(
        AmbiguousError, match='does not constrain any turn about the axis'
    ) as refused:
        merge(both(cylinder(0.02, 0.06)))
    assert '(0.00, 0.00, 1.00) through (0.0, 0.0, 0.0) mm' in str(refused.value)


@pytest.mark.slow
def test_holes_constrain_a_turn_that_nothing_else_does():
    # the flat and the keyway lie below
    place = lying(demo_part(), 11)
    merged = merge(
        [
            clamped('upright', CELL, demo_part(), np.eye(4), 120),
            clamped('lying', CELL, demo_part(), place, 120, seed=2),
        ]
    )
    found = merged.first_from_clamping[1] @ place
    assert displacement(demo_part(), found, np.eye(4)) < 1e-4
    assert merged.placings[1].sigma < 5e-5


@pytest.mark.slow
def test_regular_bolt_circle_does_not_constrain_the_turn():
    bolts = [circle(0.0045, center)[::-1] for center in 0.040 * np.array(BOLTS)]
    flange = Layer(low=0.0, high=0.012, bottom=[circle(0.052), *bolts])
    part = stack([flange, Layer(low=0.012, high=0.050, bottom=[circle(0.028)])])
    with pytest.raises(AmbiguousError):
        merge(both(part, steps=100, seed=1))


@pytest.mark.slow
def test_another_part_is_refused(upright):
    other = clamped('other', CELL, box((0.05, 0.03, 0.07)), np.eye(4), 60)
    with pytest.raises(GeometryError, match='no pose of other fits on upright'):
        merge([upright, other])


def test_scan_without_surface_is_refused_by_name(upright):
    nothing = replace(upright, name='nothing', views=[empty(view) for view in upright.views])
    with pytest.raises(GeometryError, match='merge: nothing: only 0 surfels'):
        merge([upright, nothing])


def test_one_scan_or_one_twice_is_refused(upright):
    with pytest.raises(ParameterError, match='two or more scans are needed, not upright'):
        merge([upright])
    with pytest.raises(ParameterError, match='named twice: upright, upright'):
        merge([upright, upright])


def test_clampings_of_different_cells_are_refused(upright):
    cell = replace(CELL, lasers=CELL.lasers[:1])
    with pytest.raises(ParameterError, match='upright and other were taken with different cells'):
        require_one_cell([upright, replace(upright, name='other', cell=cell)])
