# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import trimesh

from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.main import main
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import sphere
from ivfmc_ros.storage.catalogue.catalogue import Catalogue


@pytest.fixture
def mesh(tmp_path):
    """A sphere of 25 mm as the mesh of a scan, in a folder of scans."""
    folder = tmp_path / 'scans' / 'ball'
    folder.mkdir(parents=True)
    solid = sphere(0.0125)
    made = trimesh.Trimesh(solid.vertices_xyz * 1e3, solid.faces, process=False)
    made.export(folder / 'mesh.ply')
    return folder / 'mesh.ply'


@pytest.fixture
def run(capsys):
    def call(*words):
        code = 0
        try:
            main(['calibrate', 'check', *map(str, words), '--artifact-u', '0.5um'])
        except SystemExit as stop:
            code = stop.code or 0
        return code, capsys.readouterr()

    return call


def test_right_sphere_passes_and_is_certified(run, mesh, tmp_path):
    cell = bench_cell()
    save_cell(tmp_path / 'cell.yaml', cell)
    save_camera(tmp_path / 'camera.yaml', cell.camera)
    words = ('--cell', tmp_path / 'cell.yaml', '--camera', tmp_path / 'camera.yaml')
    output = tmp_path / 'check'
    code, written = run(mesh, '--artifact', 'sphere:25mm', *words, '-o', output, '--exit-code')
    assert code == 0, written.err
    assert 'verdict: pass' in written.out
    assert {path.name for path in output.iterdir()} == {
        'certificate.pdf',
        'certificate.png',
        'certificate.html',
        'check.json',
    }
    record = json.loads((tmp_path / 'cell.check.json').read_text())
    assert record['calibration'] == calibration_id(cell.turntable, cell.lasers)
    assert record == json.loads((output / 'check.json').read_text())
    assert abs(record['characteristics'][1]['value_m']) < 5e-6


def test_check_of_a_scan_is_in_the_catalogue(run, mesh, tmp_path):
    catalogue = Catalogue(mesh.parent.parent, create=True)
    catalogue.add_scan('ball', 'ball', 'default', 'DONE', {})
    assert run(mesh, '--artifact', 'sphere:25mm', '-o', tmp_path / 'check')[0] == 0
    summary = catalogue.results('ball')[0].summary
    assert summary['check']['verdict'] == 'pass'


def test_wrong_size_fails_with_its_exit_code(run, mesh, tmp_path):
    words = ('--artifact', 'sphere:25.2mm', '-o', tmp_path / 'check', '--exit-code')
    code, written = run(mesh, *words)
    assert code == 3
    assert 'verdict: fail' in written.out


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (('--artifact', 'ball_bar:25mm:100mm'), '1 of 2 spheres'),
        (('--artifact', 'cube:25mm'), 'not understood'),
        (('--artifact', 'plate'), 'plane'),
        (('--artifact', 'sphere:25mm', '--cell', 'cell.yaml'), '--camera'),
        (('--artifact', 'sphere:25mm', '--unit', 'm'), 'sphere'),
    ],
)
def test_what_cannot_be_checked_is_refused(run, mesh, tmp_path, words, text):
    code, written = run(mesh, *words, '-o', tmp_path / 'check')
    assert code == 1
    assert text in written.err
    assert not (tmp_path / 'check').exists()


def test_missing_scan_is_refused(run, tmp_path):
    code, written = run(tmp_path / 'none', '--artifact', 'sphere:25mm', '-o', tmp_path / 'check')
    assert code == 1
    assert 'none' in written.err


def test_half_of_a_sphere_is_refused(run, mesh, tmp_path):
    made = trimesh.load(mesh, process=False)
    kept = made.vertices[made.faces].mean(axis=1)[:, 0] > 4.0
    made.update_faces(np.asarray(kept))
    made.remove_unreferenced_vertices()
    made.export(mesh)
    code, written = run(mesh, '--artifact', 'sphere:25mm', '-o', tmp_path / 'check')
    assert code == 1
    assert 'half hidden' in written.err
