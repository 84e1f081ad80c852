# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re
import shutil
import subprocess

import cv2
import numpy as np
import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.reports.html import Page
from ivfmc_ros.inspection.reports.html import ReportImage
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.pdf import BROWSERS
from ivfmc_ros.meshing.filters.vertex_clustering import cluster_vertices_with_values
from ivfmc_ros.simulation.parts.solids import sphere

BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
needs_browser = pytest.mark.skipif(
    BROWSER is None, reason='no Chromium here: install chromium to see that the report renders'
)


def wavy(count):
    """A sheet of 2 * count^2 triangles and a value for each vertex."""
    y, x = np.meshgrid(np.linspace(0, 0.1, count + 1), np.linspace(0, 0.1, count + 1))
    z = 0.01 * np.sin(60 * x) * np.cos(40 * y)
    index = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    a, b, c, d = (
        i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, z], axis=2).reshape(-1, 3), faces, z.ravel() * 0.02


def page(count=40, **changes):
    vertices, faces, values = wavy(count)
    values[:50] = np.nan
    shown = {
        'title': 'a <part> & its nominal',
        'vertices_xyz': vertices,
        'faces': faces,
        'values': values,
        'span': 0.2e-3,
        'figures': {
            'verdict': 'not decided',
            'counts': {'pictures': 3, 'nothing': {}},
            'features': [{'name': 'plane 1', 'form_m': 1.5e-5, 'u_m': float('nan')}],
        },
    }
    return Page(**{**shown, **changes})


def test_page_is_one_file_without_links(tmp_path):
    write_html(tmp_path / 'report.html', page())
    text = (tmp_path / 'report.html').read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert 'http' not in re.sub(r'[A-Za-z0-9+/=]{200,}', '', text)
    assert 'a &lt;part&gt; &amp; its nominal' in text
    assert '<td>0.0150</td>' in text
    assert '<span class="not">not decided</span>' in text


def test_verdict_comes_first_and_other_parts_are_folded(tmp_path):
    figures = {
        'verdict': 'fail',
        'surface': [{'name': 'all', 'verdict': 'fail'}],
        'seconds': {'meshing': 2.0},
    }
    heading = {'part': 'a <part>', 'mesh': '/tmp/somewhere/mesh.ply', 'operator': ''}
    write_html(tmp_path / 'report.html', page(figures=figures, heading=heading))
    text = (tmp_path / 'report.html').read_text()
    assert text.index('<p class="banner fail">FAIL</p>') < text.index('<h1>')
    assert '<dt>part</dt><dd>a &lt;part&gt;</dd>' in text
    assert '<dd>mesh.ply</dd>' in text
    assert '<dt>operator</dt><dd class=blank>' in text
    assert '/somewhere' not in text
    assert '<details open><summary><h2>surface</h2>' in text
    assert '<details><summary><h2>seconds</h2>' in text


@pytest.mark.parametrize(
    ('figures', 'banner'),
    [
        ({'code': 'SLIPPED', 'inspection': {'verdict': 'pass'}}, 'banner fail">SLIPPED'),
        ({'code': 'OK', 'inspection': {'verdict': 'pass'}}, 'banner pass">PASS'),
        ({'verdict': 'not decided'}, 'banner not">NOT DECIDED'),
    ],
)
def test_scan_that_is_not_ok_shows_no_pass(tmp_path, figures, banner):
    write_html(tmp_path / 'report.html', page(figures=figures))
    assert banner in (tmp_path / 'report.html').read_text()


def test_scan_without_a_verdict_has_no_banner(tmp_path):
    write_html(tmp_path / 'report.html', page(figures={'code': 'OK'}))
    assert '<p class="banner' not in (tmp_path / 'report.html').read_text()


def test_million_triangles_stay_below_8_megabytes(tmp_path):
    write_html(tmp_path / 'report.html', page(count=710))
    assert (tmp_path / 'report.html').stat().st_size < 8e6


def test_display_mesh_keeps_its_shape_and_values():
    solid = sphere(0.02)
    values = solid.vertices_xyz[:, 2]
    vertices, faces, shown = cluster_vertices_with_values(
        solid.vertices_xyz, solid.faces, values, 5000
    )
    assert 800 < len(faces) <= 5000
    assert np.linalg.norm(vertices - (0, 0, 0.02), axis=1) == pytest.approx(0.02, abs=0.3e-3)
    assert shown == pytest.approx(vertices[:, 2], abs=1e-9)


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match=r'none.report\.html: cannot be written'):
        write_html(tmp_path / 'none' / 'report.html', page())


@needs_browser
def test_page_renders_in_a_browser_without_errors(tmp_path):
    picture = cv2.imencode('.jpg', np.full((40, 60, 3), 200, dtype=np.uint8))[1].tobytes()
    shown = [ReportImage(data=picture, media='image/jpeg', caption='gray')]
    write_html(tmp_path / 'report.html', page(pictures=shown))
    command = [
        BROWSER, '--headless=new', '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader',
        '--enable-unsafe-swiftshader', f'--user-data-dir={tmp_path / "profile"}',
        '--enable-logging=stderr', '--virtual-time-budget=15000', '--window-size=1000,900',
    ]  # fmt: skip
    address = (tmp_path / 'report.html').as_uri()
    shot = tmp_path / 'shot.png'
    ran = subprocess.run(
        [*command, f'--screenshot={shot}', '--dump-dom', address],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert 'CONSOLE' not in ran.stderr, ran.stderr
    image = cv2.imread(str(shot))
    colors = len(np.unique(image[80:600].reshape(-1, 3), axis=0))
    assert colors > 500, 'the mesh is not drawn'
