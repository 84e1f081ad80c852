# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Systematic error of points whose stripe is cut, on a shaft with a slot that was not measured."""

from dataclasses import replace

import numpy as np
import pytest
from support.cylinder_scan import stated_cell

from ivfmc_ros.meshing.samples.range_grid import RangeGrid
from ivfmc_ros.meshing.samples.stripe_footprint import footprint_margin
from ivfmc_ros.meshing.samples.stripe_footprint import systematic_sigma
from ivfmc_ros.simulation.bench import bench_cell

RADIUS, THICKNESS = 0.01, 0.35e-3
ROWS, COLUMNS = 20, 360
# Distance of neighboring columns across the sheet, in sigmas of the sheet.
STEP = RADIUS * 2 * np.pi / COLUMNS / THICKNESS


def shaft(slot=slice(0, 0)):
    """A shaft in a sheet that contains its axis, seen from 45 degrees beside it."""
    azimuth = 2 * np.pi * np.arange(COLUMNS) / COLUMNS
    normals = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(COLUMNS)], axis=1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(COLUMNS)], axis=1)
    height = 0.17e-3 * np.arange(ROWS)
    points = np.tile(RADIUS * normals, (ROWS, 1, 1))
    points[..., 2] = height[:, None]
    points[:, slot] = np.nan
    grid = RangeGrid(
        points_xyz=points,
        to_camera=np.tile((normals + across) / np.sqrt(2.0), (ROWS, 1, 1)),
        sigma=np.full((ROWS, COLUMNS), 20e-6),
        intensity=np.full((ROWS, COLUMNS), 100.0),
        closed=True,
        thickness=THICKNESS,
        sheet_normals=across,
        angle_step=2 * np.pi / COLUMNS,
    )
    known = np.isfinite(points[..., 0])
    right = known & np.roll(known, -1, axis=1)
    down = known & np.roll(known, -1, axis=0)
    down[-1] = False
    normals = np.where(known[..., None], np.tile(normals, (ROWS, 1, 1)), np.nan)
    return grid, normals, down, right


def test_whole_shaft_has_its_full_width_everywhere():
    margin = footprint_margin(*shaft())
    assert margin[2:-2].min() > 20.0
    # the stripe ends at the first and the last row
    assert (margin[[0, 1, -2, -1]] == 0.0).all()
    assert systematic_sigma(*shaft())[2:-2].max() < 1e-9


def test_margin_is_the_distance_from_what_was_not_measured():
    margin = footprint_margin(*shaft(slice(100, 140)))[ROWS // 2]
    for steps in range(8):
        assert margin[99 - steps] == pytest.approx(steps * STEP, rel=0.01)
        assert margin[140 + steps] == pytest.approx(steps * STEP, rel=0.01)
    assert (margin[100:140] == 0.0).all()


def test_systematic_error_is_the_shift_of_a_cut_gaussian():
    """At the edge half of the profile is left: its mean is 0.8 sigma off."""
    sigma = systematic_sigma(*shaft(slice(100, 140)))[ROWS // 2]
    # by how much a point leaves the surface if it leaves the middle of the sheet by one sigma: the
    # camera is at 45 degrees to both
    assert sigma[99] == pytest.approx(np.sqrt(2.0 / np.pi) * THICKNESS)
    assert (np.diff(sigma[80:100]) > 0).all()
    assert sigma[99 - 9] < 0.05 * sigma[99]


def test_crease_ends_the_surface_like_an_edge():
    grid, normals, down, right = shaft()
    bent = normals.copy()
    bent[:, 100:140] = np.roll(normals, 60, axis=1)[:, 100:140]
    margin = footprint_margin(grid, bent, down, right)[ROWS // 2]
    assert margin[99] == pytest.approx(0.0)
    assert margin[100] == pytest.approx(0.0)
    assert margin[95] == pytest.approx(4 * STEP, rel=0.01)


def test_error_of_a_sheet_of_unknown_thickness_is_not_known():
    grid, *others = shaft()
    assert np.isnan(systematic_sigma(replace(grid, thickness=0.0), *others)).all()


def test_cell_gives_the_normal_of_its_sheet():
    """The bench cell's lasers lie in planes through the axis."""
    from ivfmc_ros.meshing.samples.range_grid import make_range_grid
    from ivfmc_ros.model import View

    cell = bench_cell()
    assert stated_cell().lasers[0].thickness == 0.0
    angles = np.linspace(0.0, 1.0, 5)
    azimuth = np.radians(36.0) - angles
    on_sheet = 0.02 * np.stack([np.cos(azimuth), np.sin(azimuth), np.full(5, 1.0)], axis=1)
    view = View(
        number=0,
        laser=0,
        points_xyz=np.tile(on_sheet, (cell.camera.height, 1, 1)),
        intensity=np.ones((cell.camera.height, 5)),
        sigma=np.ones((cell.camera.height, 5)),
        uv=np.ones((cell.camera.height, 5, 2)),
        angles=angles,
        seqs=np.arange(5),
    )
    grid = make_range_grid(cell, view, np.eye(4))
    assert (on_sheet * grid.sheet_normals).sum(axis=1) == pytest.approx(np.zeros(5), abs=1e-9)
    assert np.linalg.norm(grid.sheet_normals, axis=1) == pytest.approx(np.ones(5))
    assert grid.angle_step == pytest.approx(0.25)
