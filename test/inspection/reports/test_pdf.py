# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The printed report: pages, their size, fonts; the count is that of the page objects."""

import re
import shutil

import cv2
import numpy as np
import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.reports.html import ReportImage
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.inspection_page import inspection_page
from ivfmc_ros.inspection.reports.pdf import BROWSERS
from ivfmc_ros.inspection.reports.pdf import print_pdf
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.parts.solids import demo_part

needs_browser = pytest.mark.skipif(
    not any(map(shutil.which, BROWSERS)), reason='needs Chromium: apt-get install chromium'
)
# A4 in points, as Chromium rounds it.
_A4 = (595, 842)


def many_rows(figures):
    """Figures as of a part with 120 features, of which each fifth fails."""

    def repeated(rows):
        found = (rows * 120)[:120]
        return [
            {**row, 'verdict': 'fail' if k % 5 == 0 else 'pass'} for k, row in enumerate(found)
        ]

    # of each feature once, as they are looked up by their names
    return {**figures, 'surface': repeated(figures['surface']), 'views': repeated([{'view': 1}])}


@pytest.fixture(scope='module')
def report(tmp_path_factory):
    """Page of an inspection of the demo part against itself."""
    part = demo_part()
    mesh = MeshBody(vertices_xyz=part.vertices_xyz, faces=part.faces, closed=True)
    settings = InspectSettings(tolerance=1e-4, vertex_u=1e-6)
    found = inspect(mesh, mesh, settings)
    figures = document(found, settings)
    page = inspection_page('part against nominal', found, settings, many_rows(figures))
    path = tmp_path_factory.mktemp('report') / 'report.html'
    picture = cv2.imencode('.jpg', np.full((512, 640, 3), 90, dtype=np.uint8))[1].tobytes()
    pictures = [ReportImage(data=picture, media='image/jpeg', caption=f'{k}') for k in range(6)]
    write_html(path, type(page)(**{**vars(page), 'pictures': pictures}))
    return path


@needs_browser
def test_report_is_at_most_four_pages_of_a4_with_its_fonts(report, tmp_path):
    target = tmp_path / 'report.pdf'
    print_pdf(report, target)
    data = target.read_bytes()
    boxes = re.findall(rb'/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)\s*\]', data)
    assert 1 < len(re.findall(rb'/Type\s*/Page\b', data)) <= 4
    assert {(round(float(w)), round(float(h))) for w, h in boxes} == {_A4}
    # every font brings its glyphs, as a file or as procedures
    fonts = re.findall(rb'/Type\s*/FontDescriptor\b.*?>>', data, re.DOTALL)
    assert fonts
    assert all(b'/FontFile' in font for font in fonts if b'/Type3' not in font)
    assert len(data) < 8e6


def test_without_a_browser_the_message_says_what_to_install(report, tmp_path, monkeypatch):
    monkeypatch.setenv('PATH', str(tmp_path))
    with pytest.raises(NotReadyError, match=r'chromium.* on the PATH; install chromium, or print'):
        print_pdf(report, tmp_path / 'report.pdf')
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('script', ['echo nothing to print >&2', 'exit 3'])
def test_browser_that_prints_nothing_leaves_no_file(report, tmp_path, monkeypatch, script):
    folder = tmp_path / 'bin'
    folder.mkdir()
    (folder / 'chromium').write_text(f'#!/bin/sh\n{script}\n')
    (folder / 'chromium').chmod(0o755)
    monkeypatch.setenv('PATH', f'{folder}:/bin:/usr/bin')
    with pytest.raises(FileError, match=r'report\.pdf: .*chromium wrote no PDF: '):
        print_pdf(report, tmp_path / 'report.pdf')
    assert [path.name for path in tmp_path.iterdir()] == ['bin']


@needs_browser
def test_page_that_is_missing_is_named(tmp_path):
    with pytest.raises(FileError, match=r'report\.html: file not found'):
        print_pdf(tmp_path / 'report.html', tmp_path / 'report.pdf')
