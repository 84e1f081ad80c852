# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from functools import cache
import re

import numpy as np
import pytest
from support.drifting_scan import drifting_view
from support.erring_table import stripes
from support.erring_table import Sweep

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.drift import Drift
from ivfmc_ros.registration.drift import drift_text
from ivfmc_ros.registration.drift import find_drifts
from ivfmc_ros.registration.drift import with_drifts
from ivfmc_ros.registration.sections import split_sections
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.registration.table_check import TableCheck
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder

CELL = bench_cell()
PARTS = {
    'box': lambda: box((0.045, 0.03, 0.035)).moved(
        transforms.rigid(transforms.rotation_z(0.8), (0.003, -0.006, 0.0))
    ),
    'cylinder': lambda: cylinder(0.022, 0.04),
}


@cache
def turn(name, steps=110):
    angles = 2.0 * np.pi * np.arange(steps) / steps
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    return stripes(CELL, PARTS[name](), sweeps, None)


def drifts(*views):
    return find_drifts(split_sections(views), CELL)


@pytest.mark.parametrize('name', PARTS)
@pytest.mark.parametrize('laser', [0, 1])
@pytest.mark.parametrize('size', [1e-4, -2e-4])
def test_sheet_that_moved_is_found_with_its_size(name, laser, size):
    (found,) = drifts(drifting_view(CELL, turn(name), size, laser=laser))
    assert found.laser == laser
    assert found.is_significant
    assert abs(found.size - size) < found.expanded_u
    assert found.expanded_u < 0.04e-3


@pytest.mark.parametrize('name', PARTS)
@pytest.mark.parametrize('seed', [51, 52, 53])
def test_sheet_that_stayed_has_no_drift(name, seed):
    (found,) = drifts(drifting_view(CELL, turn(name), 0.0, seed=seed))
    assert not found.is_significant
    assert abs(found.size) < found.expanded_u
    assert drift_text([found], CELL) == ''


def test_slip_of_the_table_is_no_drift():
    (found,) = drifts(drifting_view(CELL, turn('box'), 0.0, degrees=0.4))
    assert not found.is_significant
    assert np.degrees(found.rotation) == pytest.approx(0.4, abs=0.1)


def test_sweep_that_repeats_nothing_has_no_drift():
    assert drifts(drifting_view(CELL, turn('box'), 2e-4, closure=0)) == []


@pytest.mark.parametrize(
    ('name', 'laser', 'size', 'code'),
    [
        ('cylinder', 1, 2e-4, 'NOT_CONVERGED'),
        ('box', 1, 8e-5, 'NOT_CONVERGED'),
        ('box', 0, 2.5e-4, 'NOT_CONVERGED'),
    ],
)
def test_check_of_a_scan_names_the_laser_the_size_and_what_to_do(name, laser, size, code):
    # beyond what views may differ by, and where it looked like a slip, it is no OK
    view = drifting_view(CELL, turn(name), size, laser=laser)
    poses = Poses.identity(1)
    found = check_registration([view], poses, [], CELL)
    assert found.code == code
    named = re.search(rf'{CELL.lasers[laser].name} by ([+\d.]+) mm \(U = ([\d.]+) mm', found.drift)
    assert abs(1e-3 * float(named[1]) - size) < 1e-3 * float(named[2]) < 0.04e-3
    assert 'warm up' in found.drift
    assert check_registration([view], poses, []).drift == ''
    still = drifting_view(CELL, turn(name), 0.0, laser=laser)
    assert check_registration([still], poses, [], CELL).drift == ''


@pytest.mark.parametrize(
    ('before', 'size', 'rotation', 'after'),
    [
        ('OK', 9e-5, 0.0, 'OK'),
        ('UNCHECKED', 9e-5, 0.0, 'UNCHECKED'),
        ('OK', 1.3e-4, 0.0, 'NOT_CONVERGED'),
        ('SLIPPED', 9e-5, 0.0, 'NOT_CONVERGED'),
        ('SLIPPED', 9e-5, np.radians(0.5), 'SLIPPED'),
        ('SLIPPED', 3e-5, 0.0, 'SLIPPED'),
    ],
)
def test_drift_decides_with_the_check_of_the_table(before, size, rotation, after):
    drift = Drift(
        laser=0, size=size, sigma=1e-5, rotation=rotation, rotation_sigma=1e-3, fitting=0.9
    )
    found = with_drifts(TableCheck(code=before, detail='as before'), [drift], CELL)
    assert found.code == after
    assert (found.detail == 'as before') == (after == before)
    assert bool(found.drift) == (size > 4e-5)
    scattered = replace(drift, fitting=0.5)
    kept = with_drifts(TableCheck(code='SLIPPED', detail=''), [scattered], CELL)
    assert kept.code == 'SLIPPED'


@pytest.mark.parametrize('degrees', [0.4, -1.5, 5.0, 20.0])
def test_slip_stays_a_slip(degrees):
    view = drifting_view(CELL, turn('box'), 0.0, degrees=degrees)
    assert check_registration([view], Poses.identity(1), [], CELL).code == 'SLIPPED'


def test_slip_with_a_drift_is_both():
    view = drifting_view(CELL, turn('box'), 1.5e-4, degrees=0.6)
    found = check_registration([view], Poses.identity(1), [], CELL)
    assert found.code == 'SLIPPED'
    assert 'left by +0.1' in found.drift
