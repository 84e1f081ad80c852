# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import re

from click.testing import CliRunner
import numpy as np
import pytest

from ivfmc_ros.cli.inspect import inspect
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.simulation.parts.solids import box

BOX = box((0.02, 0.03, 0.05))


def fine():
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(BOX.vertices_xyz), o3d.utility.Vector3iVector(BOX.faces)
    ).subdivide_midpoint(4)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


@pytest.fixture
def mesh(tmp_path):
    write_solid(tmp_path / 'mesh.ply', *fine())
    return tmp_path / 'mesh.ply'


def run(mesh, nominal, *more):
    output = mesh.parent / 'inspected'
    stated = ('--vertex-u', '0.001')
    arguments = [str(mesh), '--nominal', str(nominal), '-o', str(output), *stated, *more]
    return CliRunner().invoke(inspect, arguments), output


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


def test_part_is_compared_with_its_nominal(mesh):
    write_solid(mesh.with_name('part.stl'), BOX.vertices_xyz, BOX.faces)
    result, output = run(mesh, mesh.with_name('part.stl'))
    assert result.exit_code == 0
    assert listing(output) == ['report.html', 'report.json']
    report = json.loads((output / 'report.json').read_text())
    assert report['verdict'] == 'pass'
    assert {row['feature'] for row in report['budget']} >= {'all', 'plane 1', 'plane 6'}
    for row in report['budget']:
        if row['u_m'] is None:
            # faces of too few patches have no form error
            assert row['characteristic'] == 'flatness'
            continue
        parts = [v for k, v in row.items() if k.endswith('_m') and k != 'u_m' and v is not None]
        assert row['u_m'] == pytest.approx(np.linalg.norm(parts), rel=1e-6)
    assert all(len(row['position_m']) == 3 and row['axis'] for row in report['features'])


def test_mesh_without_stated_uncertainty_gets_no_verdict(mesh):
    arguments = [str(mesh), '--nominal', str(mesh), '-o', str(mesh.parent / 'inspected')]
    result = CliRunner().invoke(inspect, [*arguments, '--exit-code'])
    assert result.exit_code == 4
    assert 'verdict: no uncertainty known' in result.output
    assert 'states no uncertainty of its vertices' in result.output


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('features: {plane 9: 0.1}', "no feature 'plane 9'; did you mean 'plane "),
        ('features: {plane 1: {flatnes: 0.1}}', "'flatnes' is not one of .* mean 'flatness'"),
        ('features: {plane 1: {flatness: wide}}', "plane 1: flatness: 'wide' is no number"),
        ('features: {plane 1: {flatness: -1}}', 'plane 1: flatness: .* out of range'),
        ('tolerance: 0.1', "needs the keys 'default'"),
    ],
)
def test_tolerance_that_makes_no_sense_is_named(mesh, text, message):
    path = mesh.with_name('tolerances.yaml')
    path.write_text(text)
    result, output = run(mesh, mesh, '--tolerances', str(path))
    assert isinstance(result.exception, ParameterError)
    assert re.search(message, str(result.exception))
    assert not output.exists()


@pytest.mark.parametrize(
    ('words', 'names'),
    [
        ([], ['x = 0.000 mm', 'y = 0.000 mm', 'z = 25.000 mm']),
        (['--section', 'z=10', '--section', 'y'], ['z = 10.000 mm', 'y = 0.000 mm']),
        (['--section', 'none'], []),
    ],
)
def test_sections_are_cut_where_the_user_says(mesh, words, names):
    result, output = run(mesh, mesh, *words)
    assert result.exit_code == 0
    report = json.loads((output / 'report.json').read_text())
    assert [row['name'] for row in report['sections']] == names
    page = (output / 'report.html').read_text()
    assert page.count('<figure class="section">') == len(names)
    assert all(f'section {name} of the nominal' in page for name in names)


def test_section_beside_the_part_is_refused(mesh):
    result, output = run(mesh, mesh, '--section', 'z=90')
    assert isinstance(result.exception, ParameterError)
    assert 'z = 0 and 50 mm' in str(result.exception)
    assert not output.exists()


def test_feature_is_judged_by_its_own_tolerance(mesh):
    path = mesh.with_name('tolerances.yaml')
    path.write_text('{default: 0.2, features: {plane 1: {flatness: 0.05, surface: 0.04}}}')
    result, output = run(mesh, mesh, '--tolerances', str(path))
    assert result.exit_code == 0
    report = json.loads((output / 'report.json').read_text())
    tolerances = {row['name']: row['tolerance_m'] for row in report['surface']}
    assert tolerances['plane 1'] == pytest.approx(0.04e-3)
    assert tolerances['plane 2'] == pytest.approx(0.2e-3)


def test_mesh_is_aligned_by_datum_features(mesh):
    path = mesh.with_name('datum.yaml')
    vertices, faces = fine()
    shift = np.array([0.0003, -0.0002, 0.0004])
    write_solid(mesh.with_name('moved.ply'), vertices + shift, faces)
    more = '--align', 'datum', '--datum', str(path)
    path.write_text('datums: [plane 1, plane 31]')
    result, _ = run(mesh.with_name('moved.ply'), mesh, *more)
    assert "'plane 31' is not one of plane 1" in str(result.exception)
    path.write_text('datums: [plane 1, plane 3, plane 5]')
    result, output = run(mesh.with_name('moved.ply'), mesh, *more)
    assert result.exit_code == 0
    report = json.loads((output / 'report.json').read_text())
    T = np.array(report['alignment']['nominal_from_mesh'])
    assert T[:3, 3] == pytest.approx(-shift, abs=1e-6)


@pytest.mark.parametrize('unit', ['m', 'inch'])
def test_nominal_in_another_unit_is_named_and_not_guessed(mesh, unit):
    nominal = mesh.with_name('part.stl')
    write_solid(nominal, BOX.vertices_xyz, BOX.faces, unit)
    result, output = run(mesh, nominal)
    assert isinstance(result.exception, GeometryError)
    assert 'part.stl' in str(result.exception)
    assert f'--nominal-unit {unit}, the unit of part.stl' in str(result.exception)
    assert listing(mesh.parent) == ['mesh.ply', 'part.stl']
    result, output = run(mesh, nominal, '--nominal-unit', unit)
    assert result.exit_code == 0
    assert output.is_dir()


def test_nominal_that_is_open_is_refused(mesh):
    nominal = mesh.with_name('open.stl')
    write_solid(nominal, BOX.vertices_xyz, BOX.faces[1:])
    result, _ = run(mesh, nominal)
    assert isinstance(result.exception, GeometryError)
    assert 'open.stl: the mesh is not closed' in str(result.exception)
    assert listing(mesh.parent) == ['mesh.ply', 'open.stl']


def test_results_that_exist_are_not_overwritten(mesh):
    (mesh.parent / 'inspected').mkdir()
    (mesh.parent / 'inspected' / 'report.json').write_text('earlier')
    result, output = run(mesh, mesh)
    assert isinstance(result.exception, FileError)
    assert 'exists already and is not overwritten' in str(result.exception)
    assert (output / 'report.json').read_text() == 'earlier'


def test_pdf_is_written_beside_the_page(mesh, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.cli.inspect.find_browser', lambda: 'chromium')
    monkeypatch.setattr(
        'ivfmc_ros.cli.inspect.print_pdf',
        lambda page, target: target.write_bytes(page.read_bytes()[:15]),
    )
    result, output = run(mesh, mesh, '--pdf')
    assert result.exit_code == 0
    assert listing(output) == ['report.html', 'report.json', 'report.pdf']
    assert (output / 'report.pdf').read_bytes() == b'<!doctype html>'
    assert 'report.pdf' in result.output


def test_without_a_browser_nothing_is_computed_for_a_pdf(mesh, monkeypatch):
    monkeypatch.setenv('PATH', str(mesh.parent))
    result, output = run(mesh, mesh, '--pdf')
    assert isinstance(result.exception, NotReadyError)
    assert not output.exists()
