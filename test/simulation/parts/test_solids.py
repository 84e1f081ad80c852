# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.simulation import bench
from ivfmc_ros.simulation.parts import solids
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import circle_segments
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import stack


def segment_area(radius, distance):
    """Area of a disc beyond a chord at ``distance`` from the middle."""
    half = math.acos(distance / radius)
    return radius**2 * half - distance * math.sqrt(radius**2 - distance**2)


def demo_volume():
    """The demo part's volume from its drawing."""
    rim = solids.FLANGE_RADIUS - solids.CHAMFER
    cone = solids.FLANGE_RADIUS**2 + solids.FLANGE_RADIUS * rim + rim**2
    disc = solids.FLANGE_RADIUS**2 * (solids.FLANGE_TOP - solids.CHAMFER)
    flange = math.pi * (disc + cone * solids.CHAMFER / 3)
    bolts = solids.BOLTS * math.pi * solids.BOLT_RADIUS**2 * solids.FLANGE_TOP
    hub = math.pi * solids.HUB_RADIUS**2 * (solids.HUB_TOP - solids.FLANGE_TOP)
    flat = segment_area(solids.HUB_RADIUS, solids.FLAT_DISTANCE)
    hub -= flat * (solids.HUB_TOP - solids.FLAT_FLOOR)
    shaft = math.pi * solids.SHAFT_RADIUS**2 * (solids.SHAFT_TOP - solids.HUB_TOP)
    half = solids.KEYWAY_WIDTH / 2
    mouth = math.sqrt(solids.SHAFT_RADIUS**2 - half**2)
    slot = solids.KEYWAY_WIDTH * (mouth - solids.KEYWAY_BOTTOM)
    slot += segment_area(solids.SHAFT_RADIUS, mouth)
    shaft -= slot * (solids.SHAFT_TOP - solids.KEYWAY_FLOOR)
    hole = math.pi * solids.HOLE_RADIUS**2 * (solids.SHAFT_TOP - solids.HOLE_FLOOR)
    return flange - bolts + hub + shaft - hole


def test_demo_part_is_closed_and_looks_outward(demo):
    assert demo.watertight
    assert demo.volume > 0
    assert np.isfinite(demo.normals).all()


def test_demo_part_has_the_volume_of_its_drawing(demo):
    # chords lie inside of an arc, by two thirds of the 1 um that they are allowed
    assert demo.volume == pytest.approx(demo_volume(), rel=2e-4)


def test_demo_part_fits_the_working_volume(demo):
    radius = np.hypot(*demo.vertices_xyz[:, :2].T)
    assert radius.max() == pytest.approx(solids.FLANGE_RADIUS)
    assert radius.max() < bench.VOLUME_RADIUS
    assert demo.vertices_xyz[:, 2].min() == 0.0
    assert demo.vertices_xyz[:, 2].max() == pytest.approx(solids.SHAFT_TOP)
    assert solids.SHAFT_TOP < bench.VOLUME_HEIGHT


def test_demo_part_has_its_flat_where_the_drawing_says(demo):
    middles = demo.corners_xyz.mean(axis=1)
    on_flat = np.abs(demo.normals - (1, 0, 0)).max(axis=1) < 1e-6
    on_flat &= np.abs(middles[:, 2] - 0.04) < 0.01
    assert on_flat.any()
    assert middles[on_flat, 0] == pytest.approx(solids.FLAT_DISTANCE)


def test_no_turn_maps_the_demo_part_onto_itself(demo):
    """ICP must have something to hold on to."""
    low = demo.vertices_xyz[:, 2] > solids.KEYWAY_FLOOR
    angle = np.arctan2(demo.vertices_xyz[low, 1], demo.vertices_xyz[low, 0])
    radius = np.hypot(*demo.vertices_xyz[low, :2].T)
    inner = angle[(radius < solids.SHAFT_RADIUS - 1e-4) & (radius > solids.HOLE_RADIUS + 1e-4)]
    assert np.abs(inner - solids.KEYWAY_AZIMUTH).max() < 0.4


@pytest.mark.parametrize('radius', [0.003, 0.015, 0.052])
def test_chords_are_within_a_micrometre_of_the_arc(radius):
    assert radius * (1 - math.cos(math.pi / circle_segments(radius))) <= 1e-6


@pytest.mark.parametrize(
    ('solid', 'volume'),
    [
        (solids.cylinder(0.03, 0.05), math.pi * 0.03**2 * 0.05),
        (solids.sphere(0.025), 4 / 3 * math.pi * 0.025**3),
        (solids.box((0.04, 0.03, 0.02)), 0.04 * 0.03 * 0.02),
        (solids.plate(0.08, 0.06, 0.004), 0.08 * 0.06 * 0.004),
        (
            solids.stepped_shaft([(0.04, 0.01), (0.02, 0.03), (0.03, 0.02)]),
            math.pi * (0.04**2 * 0.01 + 0.02**2 * 0.03 + 0.03**2 * 0.02),
        ),
    ],
    ids=['cylinder', 'sphere', 'box', 'plate', 'stepped shaft'],
)
def test_simple_solids_are_closed_and_have_their_volume(solid, volume):
    assert solid.watertight
    assert solid.volume == pytest.approx(volume, rel=2e-4)
    assert solid.vertices_xyz[:, 2].min() == pytest.approx(0, abs=1e-9)


def test_sphere_is_round_within_a_micrometre():
    ball = solids.sphere(0.025)
    middles = ball.corners_xyz.mean(axis=1) - (0, 0, 0.025)
    assert np.abs(np.linalg.norm(middles, axis=1) - 0.025).max() < 1e-6


def test_crossing_outlines_are_refused():
    layers = [
        Layer(low=0.0, high=0.01, bottom=[circle(0.02)]),
        Layer(low=0.01, high=0.02, bottom=[circle(0.02, (0.01, 0.0))]),
    ]
    with pytest.raises(GeometryError, match='do not close'):
        stack(layers)


def test_outline_that_runs_clockwise_is_refused():
    with pytest.raises(GeometryError, match='wrong way'):
        stack([Layer(low=0.0, high=0.01, bottom=[circle(0.02)[::-1]])])
