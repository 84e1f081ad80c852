# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The uncertainty of the vertices travels with PLY and STL files."""

import numpy as np
import pytest

from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.meshing.geometry.normals import vertex_normals
from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.model import Mesh
from ivfmc_ros.simulation.parts.solids import box


def mesh():
    part = box((0.02, 0.03, 0.05))
    number = np.arange(8)
    return Mesh(
        vertices_xyz=part.vertices_xyz,
        faces=part.faces,
        normals=vertex_normals(part.vertices_xyz, part.faces),
        sigma=np.where(number == 3, np.nan, 1e-5 * (number + 1)),
        intensity=np.ones(8),
        systematic=np.where(number == 3, np.nan, 1e-6 * number),
    )


@pytest.mark.parametrize('unit', ['mm', 'inch', 'm'])
@pytest.mark.parametrize('suffix', ['ply', 'stl'])
def test_vertices_keep_their_uncertainty(tmp_path, suffix, unit):
    made = mesh()
    write_mesh(tmp_path / f'mesh.{suffix}', made, unit)
    read = read_mesh(tmp_path / f'mesh.{suffix}', unit)
    # reading sorts the vertices
    order = np.lexsort(made.vertices_xyz.T[::-1])
    np.testing.assert_allclose(read.vertices_xyz, made.vertices_xyz[order], atol=1e-7)
    np.testing.assert_allclose(read.sigma, made.sigma[order], rtol=1e-5)
    np.testing.assert_allclose(read.systematic, made.systematic[order], rtol=1e-5)


def test_stl_without_its_file_states_nothing(tmp_path):
    write_mesh(tmp_path / 'mesh.stl', mesh())
    (tmp_path / 'mesh.stl.npz').rename(tmp_path / 'other.stl.npz')
    read = read_mesh(tmp_path / 'mesh.stl', 'mm')
    assert read.sigma is None and read.systematic is None


def test_file_of_another_stl_is_not_used(tmp_path):
    write_mesh(tmp_path / 'mesh.stl', mesh())
    data = bytearray((tmp_path / 'mesh.stl').read_bytes())
    data[100] ^= 1
    (tmp_path / 'mesh.stl').write_bytes(bytes(data))
    assert read_mesh(tmp_path / 'mesh.stl', 'mm').sigma is None


def test_damaged_file_states_nothing(tmp_path):
    write_mesh(tmp_path / 'mesh.stl', mesh())
    path = tmp_path / 'mesh.stl.npz'
    path.write_bytes(path.read_bytes()[:200])
    assert read_mesh(tmp_path / 'mesh.stl', 'mm').sigma is None


def test_mesh_that_was_not_measured_has_no_file(tmp_path):
    made = mesh()
    unknown = np.full(8, np.nan)
    write_mesh(tmp_path / 'mesh.stl', Mesh(**{**vars(made), 'sigma': unknown}))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['mesh.stl']
