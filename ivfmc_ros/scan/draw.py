# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the mesh of a scan folder and its page; ``report`` starts it as a process."""

import json
from pathlib import Path
import sys
from typing import Any

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.inspection.nominal import read_body
from ivfmc_ros.inspection.nominal import SUFFIXES
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.overview import write_mesh_sheet
from ivfmc_ros.inspection.reports.scan_page import scan_page
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.storage.scan_contents import scan_contents
from ivfmc_ros.storage.scan_contents import ScanContents

MESH, PICTURE, PAGE = 'mesh', 'mesh.png', 'report.html'


def draw_scan(folder: Path, unit: str, figures: dict[str, Any]) -> None:
    """
    Draw the mesh of a scan as ``mesh.png``, and write ``report.html``.

    unit : of the mesh files
    figures : for the page
    :raises ScanError: the mesh cannot be read, or a file cannot be written
    """
    mesh = _read_mesh(folder, unit)
    write_mesh_sheet(folder / PICTURE, mesh)
    try:
        contents = scan_contents(folder)
    except ScanError as error:
        # a mesh without its cloud is better shown than not
        contents = ScanContents(views=[], poses=Poses.identity(0), samples=[])
        figures = {**figures, 'cloud and pictures': str(error)}
    page = scan_page(folder.name, mesh, contents.views, contents.poses, contents.samples, figures)
    write_html(folder / PAGE, page)


def _read_mesh(folder: Path, unit: str) -> Mesh:
    # a PLY file comes first, for it has sigma
    known = sorted(SUFFIXES, key=lambda suffix: suffix != '.ply')
    there = [path for suffix in known if (path := folder / f'{MESH}{suffix}').is_file()]
    if not there:
        raise FileError(f'{folder}: has no {MESH} file of {", ".join(known)}')
    body = read_body(there[0], unit)
    unknown = np.full(len(body.vertices_xyz), np.nan)
    return Mesh(
        vertices_xyz=body.vertices_xyz,
        faces=body.faces,
        normals=np.full_like(body.vertices_xyz, np.nan),
        sigma=unknown if body.sigma is None else body.sigma,
        intensity=unknown,
    )


if __name__ == '__main__':
    try:
        draw_scan(Path(sys.argv[1]), sys.argv[2], json.load(sys.stdin))
    except ScanError as error:
        sys.exit(str(error))
