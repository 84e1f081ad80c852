# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.cylinder_scan import coverage
from support.cylinder_scan import stated_cell

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.inspection.uncertainty import CalibrationModes


def ring(radius=0.03, count=200):
    angle = 2 * np.pi * np.arange(count) / count
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return radius * normals + (0.0, 0.0, 0.04), normals


def test_cell_without_covariance_moves_nothing():
    cell = stated_cell()
    bare = replace(cell, turntable=replace(cell.turntable, covariance=None))
    bare = replace(bare, lasers=tuple(replace(laser, covariance=None) for laser in bare.lasers))
    points, normals = ring()
    modes = calibration_modes(bare, points, normals)
    assert modes.shifts.shape == (0, 200, 3)
    assert (modes.along_normals(points, normals, fitted=False) == 0).all()


def test_axis_that_is_nearer_makes_a_round_part_smaller_or_larger():
    # the axis' depth is what the scale of a turned part hangs on
    cell = stated_cell()
    only = np.zeros((6, 6))
    only[2, 2] = 1e-4**2
    lasers = tuple(replace(laser, covariance=None) for laser in cell.lasers)
    cell = replace(cell, turntable=replace(cell.turntable, covariance=only), lasers=lasers)
    points, normals = ring()
    modes = calibration_modes(cell, points, normals)
    radial = (modes.shifts[0] * normals).sum(axis=1)
    assert len(modes.shifts) == 1
    assert 0.05e-3 < abs(radial.mean()) < 0.3e-3
    assert radial.std() < 0.2 * abs(radial.mean())


def test_best_fit_takes_up_what_moves_the_part_as_a_whole():
    points, normals = ring()
    shift = np.tile([1e-4, 0.0, 0.0], (1, len(points), 1))
    modes = CalibrationModes(shifts=shift)
    assert modes.along_normals(points, normals, fitted=False).max() == pytest.approx(1e-4)
    assert modes.along_normals(points, normals, fitted=True).max() < 1e-9


@pytest.mark.slow
def test_diameter_of_a_miscalibrated_cell_is_within_its_interval():
    held, _ = coverage(cells=10, seed=5)
    assert held >= 8


def test_length_at_30_degrees_is_reported_at_20():
    warm = Conditions(temperature=30.0, expansion=11.5e-6)
    assert warm.to_reference == pytest.approx(1 - 115e-6, abs=1e-7)
    assert warm.relative_u == pytest.approx(10 * 1e-6)
    unsure = Conditions(temperature_u=2.0, scale_u=1e-4)
    assert unsure.relative_u == pytest.approx(np.hypot(23e-6, 1e-4))


@pytest.mark.parametrize(
    ('name', 'value'),
    [('scale_u', -1.0), ('temperature', 900.0), ('temperature_u', np.nan), ('expansion', 1.0)],
)
def test_condition_out_of_range_is_refused(name, value):
    with pytest.raises(ParameterError, match=f'^{name}: .* is out of range'):
        Conditions(**{name: value})
