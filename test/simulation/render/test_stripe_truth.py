# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import sphere
from ivfmc_ros.simulation.render.renderer import StripeRenderer

RADIUS = 0.025


@pytest.fixture(scope='module')
def ball():
    return sphere(RADIUS)


@pytest.fixture(scope='module')
def bowed(cell):
    """A cell whose first sheet is a shallow cone, 0.9 mm off its plane at 30 mm."""
    plane = cell.lasers[0]
    center = plane.intersect(np.array([[0.0, 0.0, 1.0]]))[0]
    along = np.cross(plane.normal, (0.0, 0.0, 1.0))
    bow = Bow(
        center=center, along=along / np.linalg.norm(along), coefficients=np.array([1.0, 0.3, -0.4])
    )
    return replace(cell, lasers=(replace(plane, bow=bow), cell.lasers[1]))


@pytest.fixture(scope='module')
def level(cell):
    """A cell with one sheet that lies level 20 mm above the platter: a stripe of columns."""
    base = cell.turntable.camera_from_base
    normal = base[:3, 2]
    offset = -float(normal @ (base[:3, 3] + 0.02 * normal))
    plane = LaserPlane(name='level', normal=normal, offset=offset, stripe='columns')
    return replace(cell, lasers=(plane,))


def check_geometry(cell, truth, angle):
    """Every true point is in the sheet and is seen where the truth says."""
    points = cell.turntable.to_camera(truth.points_xyz, angle)
    assert np.abs(cell.lasers[0].distance(points)).max() < 1e-9
    assert np.abs(cell.camera.project(points) - truth.uv).max() < 1e-4


@pytest.mark.parametrize('angle', [0.0, 1.1])
def test_points_lie_on_the_sphere(cell, ball, angle):
    truth = StripeRenderer(cell=cell, solid=ball, platter=None).truth(angle, 0)
    assert len(truth) > 200
    check_geometry(cell, truth, angle)
    off = np.linalg.norm(truth.points_xyz - (0, 0, RADIUS), axis=1) - RADIUS
    assert np.abs(off).max() < 1.1e-6


def test_no_row_of_the_sphere_is_missing(cell, ball):
    truth = StripeRenderer(cell=cell, solid=ball, platter=None).truth(0.0, 0)
    # at the top the stripe goes over the rim and comes back a row or two lower
    assert set(np.diff(truth.line[5:])) == {1}
    assert set(np.diff(truth.line)) <= {0, 1}


def test_part_and_platter_may_share_a_row(cell, demo):
    truth = StripeRenderer(cell=cell, solid=demo).truth(0.0, 0)
    assert len(np.unique(truth.line)) < len(truth)
    assert (np.diff(truth.line) >= 0).all()
    assert truth.points_xyz[~truth.on_part, 2] == pytest.approx(0, abs=1e-9)
    assert truth.points_xyz[truth.on_part, 2].min() > -1e-9


def test_bowed_sheet_has_its_truth(bowed, ball):
    truth = StripeRenderer(cell=bowed, solid=ball, platter=None).truth(0.4, 0)
    assert len(truth) > 200
    check_geometry(bowed, truth, 0.4)


def test_bowed_sheet_is_rendered_where_its_truth_is(bowed, centroid_errors):
    solid = box((0.05, 0.05, 0.06))
    renderer = StripeRenderer(cell=bowed, solid=solid, platter=None)
    whole = StripeRenderer(cell=bowed, solid=solid, platter=None, restrict_to_stripe=False)
    light, truth = renderer.light(0.3, 0), renderer.truth(0.3, 0)
    assert np.array_equal(light, whole.light(0.3, 0))
    side = truth.points_xyz[:, 2] < 0.06 - 1e-4
    assert np.abs(centroid_errors(light, truth)[side][15:-15]).max() < 0.02


def test_stripe_of_columns_has_one_point_a_column(level, centroid_errors):
    renderer = StripeRenderer(cell=level, solid=box((0.05, 0.05, 0.06)), platter=None)
    truth = renderer.truth(0.0, 0)
    check_geometry(level, truth, 0.0)
    assert np.array_equal(truth.uv[:, 0], truth.line)
    assert truth.points_xyz[:, 2] == pytest.approx(0.02, abs=1e-9)
    errors = centroid_errors(renderer.light(0.0, 0).T, truth)
    assert np.abs(errors[15:-15]).max() < 0.02
