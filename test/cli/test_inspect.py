# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

from click.testing import CliRunner
import pytest

from ivfmc_ros.cli.inspect import inspect
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.simulation.parts.solids import box

BOX = box((0.02, 0.03, 0.05))


@pytest.fixture
def mesh(tmp_path):
    write_solid(tmp_path / 'mesh.ply', BOX.vertices_xyz, BOX.faces)
    return tmp_path / 'mesh.ply'


def run(mesh, nominal, *more):
    output = mesh.parent / 'inspected'
    arguments = [str(mesh), '--nominal', str(nominal), '-o', str(output), *more]
    return CliRunner().invoke(inspect, arguments), output


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


def test_part_is_compared_with_its_nominal(mesh):
    write_solid(mesh.with_name('part.stl'), BOX.vertices_xyz, BOX.faces)
    result, output = run(mesh, mesh.with_name('part.stl'))
    assert result.exit_code == 0
    assert listing(output) == ['report.html', 'report.json']
    assert json.loads((output / 'report.json').read_text())['verdict'] == 'pass'


@pytest.mark.parametrize('unit', ['m', 'inch'])
def test_nominal_in_another_unit_is_named_and_not_guessed(mesh, unit):
    nominal = mesh.with_name('part.stl')
    write_solid(nominal, BOX.vertices_xyz, BOX.faces, unit)
    result, output = run(mesh, nominal)
    assert isinstance(result.exception, GeometryError)
    assert 'part.stl' in str(result.exception)
    assert f'in {unit} the sizes would agree' in str(result.exception)
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
