# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the mesh of a scan folder; ``report`` starts it as a process."""

from pathlib import Path
import sys

import numpy as np

from ivfmc_ros.errors import ScanError
from ivfmc_ros.inspection.overview import write_mesh_sheet
from ivfmc_ros.meshing.stl import read_own_stl
from ivfmc_ros.model import Mesh


def draw_mesh(folder: Path) -> None:
    """
    Draw ``mesh.stl`` of a folder as ``mesh.png``.

    :raises FileError: the mesh cannot be read, or the picture cannot be written
    """
    vertices, faces = read_own_stl(folder / 'mesh.stl')
    unknown = np.full(len(vertices), np.nan)
    mesh = Mesh(
        vertices_xyz=vertices,
        faces=faces,
        normals=np.full_like(vertices, np.nan),
        sigma=unknown,
        intensity=unknown,
    )
    write_mesh_sheet(folder / 'mesh.png', mesh)


if __name__ == '__main__':
    try:
        draw_mesh(Path(sys.argv[1]))
    except ScanError as error:
        sys.exit(str(error))
