# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import html
import json
import os
from pathlib import Path
import re
import zipfile

import numpy as np
import pytest
import trimesh

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.io import threemf
from ivfmc_ros.meshing.io.export import require_formats
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.io.export import write_cloud
from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.model import BASE
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

SUFFIXES = ('.stl', '.ply', '.obj')


def box():
    """A box of 20, 30, 40 mm in meters."""
    solid = trimesh.creation.box(extents=(0.02, 0.03, 0.04))
    vertices = np.asarray(solid.vertices, dtype=np.float64)
    return Mesh(
        vertices_xyz=vertices,
        faces=np.asarray(solid.faces, dtype=np.int64),
        normals=np.asarray(solid.vertex_normals, dtype=np.float64),
        sigma=np.linspace(1e-5, 8e-5, len(vertices)),
        intensity=np.linspace(10, 80, len(vertices)),
    )


def ply_table(path):
    """The vertices of a binary PLY by name, read without any library."""
    header, _, body = path.read_bytes().partition(b'end_header\n')
    header = header.partition(b'element face')[0]
    kinds = {b'float': '<f4', b'uchar': 'u1'}
    found = re.findall(rb'property (\w+) (\w+)', header)
    count = int(re.search(rb'element vertex (\d+)', header).group(1))
    table = np.frombuffer(body, [(name.decode(), kinds[kind]) for kind, name in found], count)
    return {name: table[name] for name in table.dtype.names}


@pytest.mark.parametrize('suffix', SUFFIXES)
@pytest.mark.parametrize(('unit', 'factor'), [('mm', 1e3), ('m', 1.0), ('inch', 1 / 0.0254)])
def test_other_software_reads_the_box_back(tmp_path, suffix, unit, factor):
    path = tmp_path / f'mesh{suffix}'
    write_mesh(path, box(), unit)
    read = trimesh.load(path)
    assert len(read.faces) == 12
    assert read.is_watertight
    assert read.extents == pytest.approx(np.array([0.02, 0.03, 0.04]) * factor, rel=1e-6)
    # positive: the faces look outward
    assert read.volume == pytest.approx(2.4e-5 * factor**3, rel=1e-5)


@pytest.mark.parametrize('suffix', SUFFIXES)
def test_unit_is_millimetre_and_written_in_the_head(tmp_path, suffix):
    path = tmp_path / f'mesh{suffix}'
    write_mesh(path, box())
    assert b'ivfmc_ros' in path.read_bytes()[:100]
    assert b'unit mm' in path.read_bytes()[:100]
    assert trimesh.load(path).extents == pytest.approx([20, 30, 40], rel=1e-6)


def test_binary_stl_is_not_taken_for_text(tmp_path):
    write_mesh(tmp_path / 'mesh.stl', box())
    data = (tmp_path / 'mesh.stl').read_bytes()
    assert not data.startswith(b'solid')
    assert len(data) == 84 + 50 * 12
    assert int.from_bytes(data[80:84], 'little') == 12


def test_suffix_counts_in_any_case(tmp_path):
    write_mesh(tmp_path / 'MESH.STL', box())
    assert (tmp_path / 'MESH.STL').stat().st_size == 84 + 50 * 12


def test_ply_holds_normals_sigma_and_intensity(tmp_path):
    write_mesh(tmp_path / 'mesh.ply', box())
    table = ply_table(tmp_path / 'mesh.ply')
    names = ['x', 'y', 'z', 'nx', 'ny', 'nz', 'sigma', 'intensity', 'quality', 'systematic']
    assert list(table) == [*names, 'red', 'green', 'blue']
    assert table['quality'].max() == 1.0
    assert table['quality'][-1] == pytest.approx(np.median(box().sigma) / 8e-5)
    assert table['red'][0] < table['red'][-1] == table['blue'][-1] == 255
    assert table['sigma'] == pytest.approx(box().sigma * 1e3, rel=1e-6)
    assert table['intensity'] == pytest.approx(box().intensity, rel=1e-6)
    normals = np.stack([table['nx'], table['ny'], table['nz']], axis=1)
    assert normals == pytest.approx(box().normals, abs=1e-6)


def test_obj_normals_are_those_of_the_vertices(tmp_path):
    write_mesh(tmp_path / 'mesh.obj', box())
    text = (tmp_path / 'mesh.obj').read_text()
    normals = np.array([line.split()[1:] for line in text.splitlines() if line[:3] == 'vn '])
    assert normals.astype(float) == pytest.approx(box().normals, abs=1e-4)
    assert 'nan' not in text
    first = re.search(r'^f (\d+)//\1 (\d+)//\2 (\d+)//\3$', text, re.MULTILINE)
    assert [int(corner) for corner in first.groups()] == (box().faces[0] + 1).tolist()


def test_ply_has_the_kind_of_each_face(tmp_path):
    kind = np.array([MEASURED] * 10 + [BASE, FILLED], dtype=np.uint8)
    write_mesh(tmp_path / 'mesh.ply', replace(box(), kind=kind))
    header, _, body = (tmp_path / 'mesh.ply').read_bytes().partition(b'end_header\n')
    faces = [('count', 'u1'), ('corners', '<i4', 3), ('kind', 'u1')]
    assert b'property uchar kind' in header
    table = np.frombuffer(body[-12 * 14 :], faces)
    assert table['kind'].tolist() == kind.tolist()
    assert (table['corners'] == box().faces).all()
    assert len(trimesh.load(tmp_path / 'mesh.ply').faces) == 12


def test_glb_is_in_meters_with_y_up(tmp_path):
    write_mesh(tmp_path / 'mesh.glb', box())
    read = trimesh.load(tmp_path / 'mesh.glb', force='mesh')
    assert read.is_watertight
    assert read.volume == pytest.approx(2.4e-5, rel=1e-5)
    assert read.extents == pytest.approx([0.02, 0.04, 0.03], rel=1e-6)


@pytest.mark.parametrize(('unit', 'factor'), [('mm', 1e3), ('inch', 1 / 0.0254), ('m', 1.0)])
def test_3mf_carries_its_unit(tmp_path, unit, factor):
    write_mesh(tmp_path / 'mesh.3mf', box(), unit)
    read = trimesh.load(tmp_path / 'mesh.3mf', force='mesh')
    assert read.is_watertight
    assert read.volume == pytest.approx(2.4e-5 * factor**3, rel=1e-5)
    name = {'mm': 'millimeter', 'inch': 'inch', 'm': 'meter'}[unit]
    with zipfile.ZipFile(tmp_path / 'mesh.3mf') as parts:
        (model,) = [part for part in parts.namelist() if part.endswith('.model')]
        text = parts.read(model).decode()
    assert f'unit="{name}"' in text
    assert 'type="surface"' not in text


def test_3mf_states_the_uncertainty(tmp_path):
    made = replace(box(), systematic=np.full(len(box().vertices_xyz), 3e-6))
    write_mesh(tmp_path / 'mesh.3mf', made)
    with zipfile.ZipFile(tmp_path / 'mesh.3mf') as parts:
        text = parts.read('3D/3dmodel.model').decode()
    stored = re.search(r'uncertainty"[^>]*>(.*?)</metadata>', text)
    stated = json.loads(html.unescape(stored[1]))
    assert stated['systematic']['median'] == pytest.approx(3e-6)
    known = made.sigma[np.isfinite(made.sigma)]
    assert stated['sigma'] == {
        'median': pytest.approx(np.median(known)),
        'p95': pytest.approx(np.percentile(known, 95)),
        'vertices': len(known),
    }
    assert sum(stated['faces'].values()) == len(made.faces)


def test_open_mesh_is_a_surface_in_3mf(tmp_path):
    write_mesh(tmp_path / 'mesh.3mf', replace(box(), faces=box().faces[:-1]))
    with zipfile.ZipFile(tmp_path / 'mesh.3mf') as parts:
        assert b'type="surface"' in parts.read('3D/3dmodel.model')


def test_3mf_without_its_library_is_refused_before_anything_is_scanned(monkeypatch):
    require_formats(['stl', '3mf'])
    monkeypatch.setattr(threemf, 'find_spec', lambda name: None)
    with pytest.raises(ParameterError, match='3mf: needs lib3mf, which is not installed'):
        require_formats(['stl', '3mf'])


def test_solid_that_was_not_measured_is_written(tmp_path):
    write_solid(tmp_path / 'part.stl', box().vertices_xyz, box().faces)
    assert trimesh.load(tmp_path / 'part.stl').volume == pytest.approx(24e3, rel=1e-5)


def test_cloud_is_points_and_sigma(tmp_path):
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (70, 3))
    write_cloud(tmp_path / 'cloud.ply', points, np.full(70, 2e-5))
    table = ply_table(tmp_path / 'cloud.ply')
    assert np.stack([table['x'], table['y'], table['z']], axis=1) == pytest.approx(
        points * 1e3, rel=1e-6
    )
    assert table['sigma'] == pytest.approx(np.full(70, 0.02))
    assert trimesh.load(tmp_path / 'cloud.ply').vertices.shape == (70, 3)
    assert b'unit mm' in (tmp_path / 'cloud.ply').read_bytes()[:100]


@pytest.mark.parametrize('name', ['mesh.step', 'mesh', 'mesh.stl.bak'])
def test_unknown_suffix_is_refused(tmp_path, name):
    with pytest.raises(
        ParameterError, match=rf"{name}: '.*' is not one of \.stl, \.ply, \.obj, \.glb, \.3mf"
    ):
        write_mesh(tmp_path / name, box())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('unit', ['cm', '', 'MM'])
def test_unknown_unit_is_refused(tmp_path, unit):
    with pytest.raises(ParameterError, match=rf"export_unit: '{unit}' is not one of m, mm, inch"):
        write_mesh(tmp_path / 'mesh.stl', box(), unit)
    with pytest.raises(ParameterError, match=rf"export_unit: '{unit}' is not one of m, mm, inch"):
        write_cloud(tmp_path / 'cloud.ply', np.zeros((1, 3)), np.zeros(1), unit)
    assert list(tmp_path.iterdir()) == []
    assert unit not in UNITS


@pytest.mark.parametrize('suffix', SUFFIXES)
def test_missing_folder_is_named(tmp_path, suffix):
    with pytest.raises(FileError, match=rf'none.mesh\{suffix}: cannot be written: No such file'):
        write_mesh(tmp_path / 'none' / f'mesh{suffix}', box())


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write anywhere')
def test_read_only_folder_is_named_and_stays_empty(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(FileError, match=r'mesh\.stl: cannot be written: Permission denied'):
            write_mesh(tmp_path / 'mesh.stl', box())
        assert list(tmp_path.iterdir()) == []
    finally:
        tmp_path.chmod(0o700)


def test_folder_that_cannot_hold_files_is_named():
    with pytest.raises(FileError, match=r'^/proc/self/mesh\.stl: cannot be written'):
        write_mesh(Path('/proc/self/mesh.stl'), box())


def test_failure_in_the_middle_leaves_the_old_file(tmp_path):
    (tmp_path / 'mesh.obj').write_text('old')
    broken = box()
    object.__setattr__(broken, 'faces', np.array([['a', 'b', 'c']]))
    with pytest.raises(TypeError):
        write_mesh(tmp_path / 'mesh.obj', broken)
    assert [path.name for path in tmp_path.iterdir()] == ['mesh.obj']
    assert (tmp_path / 'mesh.obj').read_text() == 'old'
