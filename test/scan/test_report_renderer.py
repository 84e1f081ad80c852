# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import threading

import numpy as np
import pytest

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.model import Mesh
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.report import pending_reports
from ivfmc_ros.scan.report import ReportRenderer
from ivfmc_ros.scan.report import write_figures
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


@pytest.fixture
def scan(tmp_path):
    """Return the folder of an ended scan whose report is pending, without a mesh."""
    folder = tmp_path / 'scans' / 'one'
    folder.mkdir(parents=True)
    write_figures(folder, Outcome(mesh={'unit': 'inch'}), {'messages': 7})
    scan_folder.save_job(folder, {'stage': 'DONE', 'report_pending': True})
    return folder


def test_figures_of_a_scan_are_there_before_its_images(scan):
    figures = json.loads((scan / 'report.json').read_text())
    assert (figures['code'], figures['messages'], figures['mesh']) == ('OK', 7, {'unit': 'inch'})


def test_pending_report_is_rendered_by_a_process(scan, mesh):
    write_mesh(scan / 'mesh.stl', mesh, 'inch')
    (scan.parent / 'no scan').mkdir()
    assert pending_reports(scan.parent) == [scan]
    assert ReportRenderer().render(scan) == ''
    assert '<canvas' in (scan / 'report.html').read_text()
    assert (scan / 'mesh.png').is_file()
    assert pending_reports(scan.parent) == []


def test_error_of_the_rendering_process_is_reported(scan):
    error = ReportRenderer().render(scan)
    assert 'mesh.png: could not be rendered: ' in error
    assert 'has no mesh file' in error
    assert scan_folder.load_job(scan)['picture_error'] == error
    # not tried again at every start
    assert pending_reports(scan.parent) == []


def test_closed_renderer_leaves_the_report_pending(scan, mesh):
    write_mesh(scan / 'mesh.stl', mesh, 'inch')
    renderer = ReportRenderer()
    timer = threading.Timer(0.2, renderer.close)
    timer.start()
    with pytest.raises(CancelledError):
        renderer.render(scan)
    with pytest.raises(CancelledError):
        renderer.render(scan)
    assert pending_reports(scan.parent) == [scan]


def test_missing_root_has_no_pending_reports(tmp_path):
    assert pending_reports(tmp_path / 'none') == []
