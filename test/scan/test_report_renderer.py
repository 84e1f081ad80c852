# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.model import Mesh
from ivfmc_ros.scan.report import render_in_process
from ivfmc_ros.scan.report_renderer import render_scan


@pytest.fixture
def mesh():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float) * 0.02
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Mesh(
        vertices_xyz=corners,
        faces=faces,
        normals=np.full_like(corners, np.nan),
        sigma=np.full(4, 2e-5),
        intensity=np.full(4, 100.0),
    )


@pytest.mark.parametrize('suffix', ['stl', 'ply', 'obj'])
def test_mesh_of_any_format_is_rendered(tmp_path, mesh, suffix):
    write_mesh(tmp_path / f'mesh.{suffix}', mesh, 'inch')
    render_scan(tmp_path, 'inch', {'code': 'OK'})
    assert (tmp_path / 'mesh.png').read_bytes()[:4] == b'\x89PNG'
    page = (tmp_path / 'report.html').read_text()
    # the folder has no bag: the page names the error and shows the mesh
    assert 'points and images' in page
    assert '<canvas' in page


def test_sigma_of_a_ply_is_shown(tmp_path, mesh):
    write_mesh(tmp_path / 'mesh.ply', mesh, 'mm')
    write_mesh(tmp_path / 'mesh.stl', mesh, 'mm')
    render_scan(tmp_path, 'mm', {})
    assert '0.02 mm' in (tmp_path / 'report.html').read_text()


def test_folder_without_a_mesh_is_refused(tmp_path):
    with pytest.raises(FileError, match='has no mesh file'):
        render_scan(tmp_path, 'mm', {})


def test_error_of_the_rendering_process_is_reported(tmp_path):
    with pytest.raises(FileError, match=r'could not be rendered: .*has no mesh file'):
        render_in_process(tmp_path, 'mm', {})
