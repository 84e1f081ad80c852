# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.simulation import bench
from ivfmc_ros.simulation.render.optics import axis_depth
from ivfmc_ros.simulation.render.sources import default_source
from ivfmc_ros.simulation.render.sources import default_sources


def base_from_camera(cell):
    return transforms.invert(cell.turntable.camera_from_base)


def test_camera_stands_where_the_design_says(cell):
    center = base_from_camera(cell)[:3, 3]
    aim = np.array([0.0, 0.0, 0.045])
    assert np.linalg.norm(center - aim) == pytest.approx(0.4)
    assert np.arcsin((center - aim)[2] / 0.4) == pytest.approx(np.radians(20))
    assert center[1] == pytest.approx(0, abs=1e-12)
    assert center[0] > 0  # x of the base points to the camera


def test_camera_looks_at_the_axis_upright(cell):
    aim, higher = cell.turntable.to_camera(np.array([[0, 0, 0.045], [0, 0, 0.06]]), 0.7)
    assert cell.camera.project([aim])[0] == pytest.approx([639.5, 511.5])
    assert cell.camera.project([higher])[0, 1] < 511
    assert axis_depth(cell) == pytest.approx(0.4)


@pytest.mark.parametrize(('index', 'degrees'), [(0, 36.0), (1, -30.0)])
def test_planes_hold_the_axis_and_their_azimuth(cell, index, degrees):
    azimuth = np.radians(degrees)
    in_plane = np.array(
        [[0, 0, 0], [0, 0, 0.1], [0.05 * np.cos(azimuth), 0.05 * np.sin(azimuth), 0.02]]
    )
    distance = cell.lasers[index].distance(cell.turntable.to_camera(in_plane, 0.0))
    assert distance == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(('index', 'degrees'), [(0, 36.0), (1, -30.0)])
def test_sources_stand_in_their_planes(cell, index, degrees):
    source = default_sources(cell)[index].position
    assert cell.lasers[index].distance(source[None]) == pytest.approx(0, abs=1e-12)
    x, y, z = transforms.apply(base_from_camera(cell), source)
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(degrees)
    assert z > 0.1


def test_a_level_sheet_has_a_level_source(cell):
    normal = cell.turntable.camera_from_base[:3, 2]
    middle = transforms.apply(cell.turntable.camera_from_base, np.array([0, 0, 0.03]))
    level = LaserPlane(name='level', normal=normal, offset=float(-normal @ middle))
    source = default_source(cell, level).position
    assert level.distance(source[None]) == pytest.approx(0, abs=1e-12)
    x, _, z = transforms.apply(base_from_camera(cell), source)
    assert (x, z) == pytest.approx((0.4, 0.03))


def test_working_volume_is_in_the_picture(cell):
    turn = np.linspace(0, 2 * np.pi, 90)
    ring = bench.VOLUME_RADIUS * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for height in (0.0, bench.VOLUME_HEIGHT):
        points = np.column_stack([ring, np.full(len(ring), height)])
        uv = cell.camera.project(cell.turntable.to_camera(points, 0.0))
        assert (uv > 0).all()
        assert (uv < np.array(bench.SIZE) - 1).all()
