# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lens out of focus makes the stripes of any part wider, and the scan says so."""

from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import stepped_shaft
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings

OPTICS = Optics()
CELL = with_sheet_thickness(bench_cell(), OPTICS)
STEPS = 40
SHAFT = [(0.03, 0.02), (0.02, 0.02)]


def scanned(part, *, blur=1.0, cell=CELL, steps=STEPS, seen_by=CELL):
    """
    Return the acquisition of a scan whose stripes are wider than when calibrated.

    cell : with which it is triangulated; seen_by : that of the pictures
    """
    optics = replace(OPTICS, stripe_sigma=blur * OPTICS.stripe_sigma)
    frames = simulate_scan(seen_by, part, steps, lasers=[1], seed=5, optics=optics)
    acquisition = Acquisition(cell, AcquisitionSettings(volume=Volume(bottom=0.5e-3)))
    for frame in frames:
        acquisition.profile(frame)
    return acquisition


@pytest.fixture(scope='module')
def blurred():
    return scanned(stepped_shaft(SHAFT), blur=1.6)


@pytest.mark.parametrize('part', [stepped_shaft(SHAFT), box((0.04, 0.04, 0.04))])
def test_sheet_is_as_thick_on_any_part(part):
    found = scanned(part).sheets()
    assert found.ratio == {'right': pytest.approx(1.0, abs=0.07)}
    assert found.advice == ''


def test_wider_stripe_is_said_with_what_may_have_happened(blurred):
    found = blurred.sheets()
    assert found.ratio['right'] == pytest.approx(1.6, abs=0.12)
    assert 'laser right: its sheet looks' in found.advice
    assert 'focus' in found.advice
    assert 'scatters' in found.advice


def test_narrower_stripe_can_only_be_a_changed_focus():
    found = scanned(stepped_shaft(SHAFT), blur=0.6).sheets()
    assert found.ratio['right'] == pytest.approx(0.6, abs=0.06)
    assert found.advice.endswith('the focus of camera or laser was changed; calibrate both again')


def test_nothing_is_said_where_the_material_shapes_the_stripe(blurred):
    settings = blurred.settings
    for change in ({'glare': 'on'}, {'method': 'top_of_peak'}):
        blurred.settings = replace(settings, extract=replace(settings.extract, **change))
        assert blurred.sheets() is None
    blurred.settings = settings


def test_nothing_is_known_of_few_profiles_or_of_a_sheet_that_was_not_calibrated(blurred):
    assert scanned(stepped_shaft(SHAFT), steps=10).sheets().ratio == {}
    thin = replace(CELL, lasers=tuple(replace(laser, thickness=0.0) for laser in CELL.lasers))
    assert scanned(stepped_shaft(SHAFT), cell=thin).sheets().ratio == {}
    assert blurred.for_new_scan().sheets().ratio == {}


def turned_by_90_degrees(cell):
    """Return the cell with its camera turned about its line of sight: stripes lie in columns."""
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    K, camera, table = cell.camera.K, cell.camera, cell.turntable
    turned = np.diag([K[1, 1], K[0, 0], 1.0])
    turned[:2, 2] = camera.height - 1.0 - K[1, 2], K[0, 2]
    pose = np.eye(4)
    pose[:3, :3] = quarter
    return replace(
        cell,
        camera=replace(camera, width=camera.height, height=camera.width, K=turned),
        turntable=replace(table, camera_from_base=pose @ table.camera_from_base),
        lasers=tuple(
            replace(laser, normal=quarter @ laser.normal, stripe='columns')
            for laser in cell.lasers
        ),
    )


def test_stripes_that_lie_in_columns_are_judged_too():
    cell = turned_by_90_degrees(CELL)
    found = scanned(stepped_shaft(SHAFT), cell=cell, seen_by=cell).sheets()
    assert found.ratio == {'right': pytest.approx(1.0, abs=0.07)}
