# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.samples.thickness import inward
from ivfmc_ros.meshing.samples.thickness import Light
from ivfmc_ros.meshing.samples.view_samples import from_views
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings


def shaft(radius, columns=60):
    """A vertical cylinder, seen from +x where it faces +x, in a sheet 40 degrees aside."""
    azimuth = np.linspace(-0.3, 0.3, columns)
    normals = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    points = radius * normals + np.linspace(0, 0.01, 50)[:, None, None] * [0, 0, 1]
    error = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    shape = points.shape
    light = Light(
        sight=np.broadcast_to([1.0, 0.0, 0.0], shape),
        error=np.broadcast_to(error, shape),
        thickness=0.35e-3,
    )
    return points, np.broadcast_to(normals, shape), light


def linked(points):
    yes = np.ones(points.shape[:2], dtype=bool)
    yes[:, -1] = False
    return yes


def test_the_error_grows_with_curvature_and_the_square_of_the_thickness():
    points, normals, light = shaft(0.012)
    here = inward(points, normals, linked(points), light)[25, 30]
    assert here > 1e-6
    points, normals, _ = shaft(0.024)
    assert inward(points, normals, linked(points), light)[25, 30] == pytest.approx(here / 2, 0.01)
    thin = Light(sight=light.sight, error=light.error, thickness=0.5 * light.thickness)
    assert inward(points, normals, linked(points), thin)[25, 30] == pytest.approx(here / 8, 0.01)


def test_a_hollow_errs_the_other_way():
    points, normals, light = shaft(0.012)
    hollow = -points + 2 * points[:, 30:31]
    found = inward(hollow, normals, linked(points), light)[25, 30]
    convex = inward(points, normals, linked(points), light)[25, 30]
    assert found == pytest.approx(-convex, rel=0.05)


def test_an_edge_is_no_curve():
    points, normals, light = shaft(0.012)
    bent = normals.copy()
    bent[:, 30:] = [0.0, 1.0, 0.0]
    alone = inward(points, normals, linked(points), light)
    assert np.abs(inward(points, bent, linked(points), light)).max() <= 1.1 * alone.max()


@pytest.mark.parametrize('laser', [0, 1])
def test_points_of_a_rendered_shaft_come_to_lie_on_it(laser):
    radius = 0.012
    cell = with_thickness(bench_cell(), Optics())
    volume = Volume(bottom=0.02, top=0.035)
    frames = simulate_scan(cell, cylinder(radius, 0.05), 40, lasers=[laser])
    settings = Settings(acquisition=AcquisitionSettings(volume=volume))
    made = reconstruct(cell, frames, settings)
    off = []
    for known in (bench_cell(), cell):
        samples = from_views(known, made.views, made.poses, None, 1.0)
        off.append(np.hypot(*samples.points_xyz[:, :2].T).mean() - radius)
    assert off[0] < -15e-6
    assert abs(off[1]) < 3e-6
