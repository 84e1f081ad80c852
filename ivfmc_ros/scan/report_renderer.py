# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Renders ``mesh.png`` and ``report.html`` of a scan folder; ``report`` runs it as a process."""

import json
import os
from pathlib import Path
import sys
from typing import Any

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.mesh_file import SUFFIXES
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.overview import write_mesh_sheet
from ivfmc_ros.inspection.reports.scan_page import mesh_still
from ivfmc_ros.inspection.reports.scan_page import scan_page
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.scan.report import MESH_IMAGE
from ivfmc_ros.scan.report import REPORT
from ivfmc_ros.scan.report import REPORT_PAGE
from ivfmc_ros.scan.title_block import title_block
from ivfmc_ros.scan.title_block import without_folder
from ivfmc_ros.storage.scans.scan_contents import scan_contents
from ivfmc_ros.storage.scans.scan_contents import ScanContents
from ivfmc_ros.worker import end_with_parent

# Files of a scan folder: stem of the mesh files, image of the mesh, report page.
MESH_STEM = 'mesh'
# Nice value of the process: a scan may be running, whose nodes come first.
_NICE = 15


def render_scan(folder: Path, unit: str, figures: dict[str, Any]) -> None:
    """
    Render the mesh of a scan as ``mesh.png`` and write the page ``report.html``.

    unit : length unit of the mesh files: m, mm or inch
    figures : key figures to show on the page, by name
    :raises ScanError: the mesh cannot be read, or a file cannot be written
    """
    mesh = _read_mesh(folder, unit)
    write_mesh_sheet(folder / MESH_IMAGE, mesh)
    try:
        contents = scan_contents(folder)
    except ScanError as error:
        # the page is useful without points and images: show the mesh and the reason
        contents = ScanContents(views=[], poses=Poses.identity(0), samples=[])
        figures = {**figures, 'points and images': str(error)}
    page = scan_page(
        folder.name,
        mesh,
        contents.views,
        contents.poses,
        contents.samples,
        without_folder(figures, folder),
        title_block(folder),
        mesh_still(folder / MESH_IMAGE),
    )
    write_html(folder / REPORT_PAGE, page)


def _read_mesh(folder: Path, unit: str) -> Mesh:
    # PLY first: it is the only format that stores sigma
    suffixes = sorted(SUFFIXES, key=lambda suffix: suffix != '.ply')
    existing = [path for suffix in suffixes if (path := folder / f'{MESH_STEM}{suffix}').is_file()]
    if not existing:
        raise FileError(f'{folder}: has no {MESH_STEM} file of {", ".join(suffixes)}')
    body = read_mesh(existing[0], unit)
    unknown = np.full(len(body.vertices_xyz), np.nan)
    return Mesh(
        vertices_xyz=body.vertices_xyz,
        faces=body.faces,
        normals=np.full_like(body.vertices_xyz, np.nan),
        sigma=unknown if body.sigma is None else body.sigma,
        intensity=unknown,
    )


def _read_figures(folder: Path) -> dict[str, Any]:
    """:raises FileError: ``report.json`` cannot be read."""
    path = folder / REPORT
    try:
        return dict(json.loads(path.read_text(encoding='utf-8')))
    except (OSError, ValueError, TypeError) as error:
        raise FileError(f'{path}: cannot be read: {error}') from error


def main() -> None:
    """Render the scan folder that the command line names."""
    end_with_parent()
    os.nice(_NICE)
    folder = Path(sys.argv[1])
    try:
        figures = _read_figures(folder)
        unit = str((figures.get('mesh') or {}).get('unit', 'mm'))
        render_scan(folder, unit, figures)
    except ScanError as error:
        sys.exit(str(error))


if __name__ == '__main__':
    main()
