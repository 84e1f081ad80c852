# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.scan.scan_folder import save_job
from ivfmc_ros.scan.stored_recipe import RECIPE_FOLDER
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.window.placed_nominal import fit_nominal
from ivfmc_ros.window.placed_nominal import load_placed_nominal
from ivfmc_ros.window.placed_nominal import plan_of_scan

BOX = box((0.02, 0.03, 0.05))
SHIFT = np.array([0.004, -0.003, 0.001])
DOCUMENT = {
    'recipe': 'fine',
    'nominal': 'part.stl',
    'tolerance_m': 1e-4,
    'conditions': {'temperature': 20.0},
    'alignment': {'nominal_from_mesh': transforms.rigid(np.eye(3), -SHIFT).tolist()},
}


@pytest.fixture
def scan(tmp_path):
    folder = tmp_path / 'scan'
    folder.mkdir()
    (folder / 'inspection.json').write_text(json.dumps(DOCUMENT))
    return folder


@pytest.fixture
def recipes(scan):
    """The copy of the recipe in the folder of the scan."""
    folder = scan / RECIPE_FOLDER
    folder.mkdir()
    write_solid(folder / 'part.stl', BOX.vertices_xyz, BOX.faces)
    (folder / 'fine.yaml').write_text('inspection: {nominal: part.stl, tolerance: 0.1}')
    return folder


def test_points_are_compared_where_the_inspection_placed_the_nominal(scan, recipes):
    placed = load_placed_nominal(scan)
    # the top face of the box, as it lies in the scan
    top = np.array([0.0, 0.0, BOX.vertices_xyz[:, 2].max()]) + SHIFT
    points = top + np.array([(0, 0, 2e-4), (0, 0, 0), (0, 0, -1e-4)])
    assert placed.deviations(points) == pytest.approx([2e-4, 0.0, -1e-4], abs=1e-8)
    assert placed.bar.high == 2e-4


def test_lengths_of_a_warm_part_are_reduced_to_20_degrees(scan, recipes):
    warm = {'temperature': 120.0, 'expansion': 1e-5}
    (scan / 'inspection.json').write_text(json.dumps({**DOCUMENT, 'conditions': warm}))
    assert load_placed_nominal(scan).scale == pytest.approx(1.0 / 1.001)


def test_scan_without_an_inspection_or_without_a_recipe_has_none(scan):
    assert load_placed_nominal(scan) is None
    (scan / 'inspection.json').unlink()
    assert load_placed_nominal(scan) is None


def test_copy_that_is_not_the_recipe_of_the_inspection_is_refused(scan, recipes):
    write_solid(recipes / 'other.stl', BOX.vertices_xyz, BOX.faces)
    (recipes / 'fine.yaml').write_text('inspection: {nominal: other.stl, tolerance: 0.1}')
    with pytest.raises(RecipeError, match=r'has not the nominal of the inspection, part\.stl'):
        load_placed_nominal(scan)
    (recipes / 'fine.yaml').unlink()
    with pytest.raises(RecipeError, match='there is no'):
        load_placed_nominal(scan)


@pytest.mark.parametrize('text', ['', '[]', '{"recipe": "fine"}'])
def test_damaged_result_of_an_inspection_is_refused(scan, recipes, text):
    (scan / 'inspection.json').write_text(text)
    with pytest.raises(FileError, match=r'inspection\.json: is no result of an inspection'):
        load_placed_nominal(scan)


def plan_of(scan):
    save_job(scan, {'stage': 'MESHING', 'request': {'recipe': 'fine'}})
    return plan_of_scan(scan)


def test_points_are_compared_before_the_inspection_by_a_fit(scan, recipes):
    plan = plan_of(scan)
    rng = np.random.default_rng(0)
    # on the faces of the box, at another place
    low, high = BOX.vertices_xyz.min(axis=0), BOX.vertices_xyz.max(axis=0)
    points = rng.uniform(low, high, (6000, 3))
    axis = rng.integers(0, 3, 6000)
    rows = np.arange(6000)
    points[rows, axis] = np.where(rng.random(6000) < 0.5, low[axis], high[axis])
    placed = fit_nominal(points + SHIFT / 10.0, plan)
    assert placed.is_provisional
    assert 'provisional' in placed.bar.quantity
    assert np.abs(placed.deviations(points + SHIFT / 10.0)).max() < 2e-6


def test_points_of_another_part_are_not_compared(scan, recipes):
    rng = np.random.default_rng(0)
    assert fit_nominal(rng.uniform(-0.1, 0.1, (4000, 3)), plan_of(scan)) is None


def test_scan_that_is_not_judged_or_by_datums_has_no_plan(scan, recipes):
    (recipes / 'fine.yaml').write_text('scan: {profiles: 90}')
    assert plan_of(scan) is None
    save_job(scan, {'stage': 'MESHING', 'request': {'recipe': ''}})
    assert plan_of_scan(scan) is None
