# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.samples.row_curvature import row_curvature
from ivfmc_ros.meshing.samples.thickness import SheetThickness
from ivfmc_ros.meshing.samples.thickness import thickness_bias
from ivfmc_ros.meshing.samples.view_samples import sample_views
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings


def shaft(radius, columns=60, around=(-0.3, 0.3)):
    """Return a vertical cylinder seen from +x in a light sheet at 40 degrees."""
    azimuth = np.linspace(*around, columns)
    normals = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    points = radius * normals + np.linspace(0, 0.01, 50)[:, None, None] * [0, 0, 1]
    error = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    shape = points.shape
    sheet = SheetThickness(
        to_camera=np.broadcast_to([1.0, 0.0, 0.0], shape),
        error_direction=np.broadcast_to(error, shape),
        thickness=0.35e-3,
    )
    return points, np.broadcast_to(normals, shape), sheet


def connected(points):
    yes = np.ones(points.shape[:2], dtype=bool)
    yes[:, -1] = False
    return yes


def corrected(points, normals, sheet):
    right, down = connected(points), np.ones(points.shape[:2], dtype=bool)
    down[-1] = False
    curvature = row_curvature(points, normals, right, down, sheet.thickness)
    return thickness_bias(curvature, normals, sheet)


def bias(points, normals, sheet):
    return corrected(points, normals, sheet)[0]


def test_bias_grows_with_curvature_and_the_square_of_the_thickness():
    points, normals, sheet = shaft(0.012)
    here = bias(points, normals, sheet)[25, 30]
    assert here > 1e-6
    points, normals, _ = shaft(0.024)
    assert bias(points, normals, sheet)[25, 30] == pytest.approx(here / 2, 0.01)
    thin = replace(sheet, thickness=0.5 * sheet.thickness)
    assert bias(points, normals, thin)[25, 30] == pytest.approx(here / 8, 0.01)


def test_bias_of_a_concave_surface_has_the_opposite_sign():
    points, normals, sheet = shaft(0.012)
    hollow = -points + 2 * points[:, 30:31]
    found = bias(hollow, normals, sheet)[25, 30]
    convex = bias(points, normals, sheet)[25, 30]
    assert found == pytest.approx(-convex, rel=0.05)


def test_curvature_that_is_too_coarse_to_correct_is_an_uncertainty():
    """With 30 degrees between columns nothing tells a pin from a polygon."""
    radius, columns = 0.004, 5
    points, normals, sheet = shaft(0.012)
    fine, known = corrected(points, normals, sheet)
    azimuth = np.radians(30.0) * (np.arange(columns) - columns // 2)
    turned = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    sparse = radius * turned + np.linspace(0, 0.01, 50)[:, None, None] * [0, 0, 1]
    cut = SheetThickness(
        to_camera=sheet.to_camera[:, :columns],
        error_direction=sheet.error_direction[:, :columns],
        thickness=sheet.thickness,
    )
    found, u = corrected(sparse, np.broadcast_to(turned, sparse.shape), cut)
    assert (found == 0.0).all()
    # in proportion to the curvature
    assert u[25, columns // 2] == pytest.approx(3 * fine[25, 30], rel=0.1)
    # where it is corrected, a part of the correction is uncertain, and what is of higher order
    assert 0.25 * fine[25, 30] < known[25, 30] < 0.35 * fine[25, 30]


def test_points_near_the_terminator_are_uncertain():
    """The light comes from 0.7 rad: its terminator is at -0.87 rad."""
    points, normals, sheet = shaft(0.012, around=(-0.7, 0.1))
    u = corrected(points, normals, sheet)[1][25]
    # at 0.2 rad from it, 0.7 sigmas of the sheet; at 0.8 rad, 10 sigmas
    assert u[3] > 0.5 * sheet.thickness
    assert u[52] < 0.03 * sheet.thickness
    assert (np.diff(u[6:40]) < 0.0).all()
    # light that grazes a concave surface is not cut
    hollow = -points + 2 * points[:, 30:31]
    assert (corrected(hollow, normals, sheet)[1][25, 8:30] < u[8:30]).all()


def test_uncertainty_without_correction_is_at_most_the_thickness():
    points, normals, sheet = shaft(0.012)
    shaken = points + np.random.default_rng(1).normal(0.0, 1e-3, points.shape)
    found, u = corrected(shaken, normals, sheet)
    assert np.isfinite(found).all()
    assert (u <= sheet.thickness).all()


@pytest.mark.parametrize('laser', [0, pytest.param(1, marks=pytest.mark.slow)])
def test_points_of_a_rendered_shaft_lie_on_it(laser):
    radius = 0.012
    cell = with_sheet_thickness(bench_cell(), Optics())
    volume = Volume(bottom=0.02, top=0.035)
    frames = simulate_scan(cell, cylinder(radius, 0.05), 40, lasers=[laser])
    settings = Settings(acquisition=AcquisitionSettings(volume=volume))
    made = reconstruct(cell, frames, settings)
    off = []
    for known in (bench_cell(), cell):
        samples = sample_views(known, made.views, made.poses, None, 1.0)
        off.append(np.hypot(*samples.points_xyz[:, :2].T).mean() - radius)
    assert off[0] < -15e-6
    assert abs(off[1]) < 3e-6
