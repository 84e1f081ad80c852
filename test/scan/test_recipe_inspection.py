# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recipe judges the mesh in the folder of a scan, in a process of its own."""

from dataclasses import replace
import json
import time

import numpy as np
import open3d
import pytest
from support.synthetic import small_cell
import yaml

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe_inspection import inspect_scan
from ivfmc_ros.scan.recipe_verdict import InspectionProcess
from ivfmc_ros.scan.stored_recipe import load_stored_recipe
from ivfmc_ros.scan.stored_recipe import store_recipe
from ivfmc_ros.scan.temperature import save_temperature
from ivfmc_ros.scan.temperature import ScanTemperature
from ivfmc_ros.simulation.parts.solids import box

SIZE = (0.02, 0.03, 0.05)


@pytest.fixture
def root(tmp_path):
    root = tmp_path / 'recipes'
    root.mkdir()
    part = box(SIZE)
    write_solid(root / 'box.stl', part.vertices_xyz, part.faces)
    document = {'inspection': {'nominal': 'box.stl', 'tolerance': 0.1}}
    (root / 'box.yaml').write_text(yaml.safe_dump(document))
    return root


def scanned(folder, root, size=SIZE, unit='mm'):
    """Write the folder of a scan with a mesh that states no uncertainty, and with its recipe."""
    folder.mkdir()
    store_recipe(load_recipe(root, 'box'), root, folder)
    part = box(size)
    fine = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(part.vertices_xyz),
        open3d.utility.Vector3iVector(part.faces),
    ).subdivide_midpoint(4)
    write_solid(folder / 'mesh.stl', np.asarray(fine.vertices), np.asarray(fine.triangles))
    cell = small_cell()
    save_cell(folder / 'cell.yaml', cell)
    save_camera(folder / 'camera.yaml', cell.camera)
    scan_folder.save_job(folder, {'stage': 'MESHING', 'request': {'export_unit': unit}})
    return folder


def ended(process):
    deadline = time.monotonic() + 120.0
    while not process.is_done:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return process.result()


def test_mesh_is_judged_with_a_known_uncertainty(tmp_path, root):
    folder = scanned(tmp_path / 'scan', root)
    recipe = load_stored_recipe(folder, 'box')
    settings = replace(recipe.inspection.settings, vertex_u=1e-6)
    plan = replace(recipe.inspection, settings=settings)
    figures = inspect_scan(folder, replace(recipe, inspection=plan))
    assert figures['verdict'] == 'pass'
    stored = json.loads((folder / 'inspection.json').read_text())
    assert (stored['recipe'], stored['nominal']) == ('box', 'box.stl')
    assert (folder / 'inspection.html').stat().st_size > 10_000


def test_sensor_gives_the_temperature_of_the_part_unless_the_recipe_does(tmp_path, root):
    folder = scanned(tmp_path / 'scan', root)
    save_temperature(folder, ScanTemperature(mean_c=25, u_k=0.2, low_c=25, high_c=25, readings=1))
    conditions = inspect_scan(folder, load_stored_recipe(folder, 'box'))['conditions']
    assert (conditions['temperature'], conditions['temperature_u']) == (25, 0.2)
    document = yaml.safe_load((root / 'box.yaml').read_text())
    document['inspection']['temperature'] = 21.5
    (root / 'box.yaml').write_text(yaml.safe_dump(document))
    conditions = inspect_scan(folder, load_recipe(root, 'box'))['conditions']
    assert (conditions['temperature'], conditions['temperature_u']) == (21.5, 0.0)


def test_process_says_what_it_found_in_short(tmp_path, root):
    process = InspectionProcess(scanned(tmp_path / 'scan', root), 'box')
    result = ended(process)
    process.kill()
    # never a pass without a known uncertainty
    assert result['verdict'] == 'no uncertainty known'
    assert result['recipe'] == 'box'
    assert 'states no uncertainty' in result['notes'][0]
    assert {row['name'] for row in result['surface']} >= {'all', 'plane 1'}
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (lambda folder: (folder / 'mesh.stl').unlink(), 'has none of mesh.ply, mesh.stl'),
        (lambda folder: (folder / 'mesh.stl').write_bytes(b'x'), 'mesh.stl'),
        (lambda folder: (folder / 'cell.yaml').unlink(), 'cell.yaml'),
    ],
)
def test_nothing_is_decided_where_the_mesh_cannot_be_judged(tmp_path, root, change, said):
    folder = scanned(tmp_path / 'scan', root)
    change(folder)
    process = InspectionProcess(folder, 'box')
    result = ended(process)
    process.kill()
    assert result['verdict'] == 'not decided'
    assert said in result['reason']


def test_process_that_is_killed_is_gone(tmp_path, root):
    process = InspectionProcess(scanned(tmp_path / 'scan', root), 'box')
    process.kill()
    assert process.is_done
