# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the range scans of the Stanford bunny: ASCII PLY range grids, and poses in bun.conf."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.meshing.samples.range_grid import RangeGrid


def read_bunny(folder: Path) -> list[RangeGrid]:
    """Return all scans in the common frame of bun.conf, meters."""
    grids = []
    for line in (folder / 'bun.conf').read_text().splitlines():
        words = line.split()
        if not words or words[0] != 'bmesh':
            continue
        R = Rotation.from_quat(np.array(words[5:9], dtype=np.float64)).as_matrix()
        points = read_grid(folder / words[1]) @ R + np.array(words[2:5], dtype=np.float64)
        shape = points.shape[:2]
        grids.append(
            RangeGrid(
                points_xyz=points,
                to_camera=np.broadcast_to(R.T @ [0.0, 0.0, 1.0], points.shape),
                sigma=np.full(shape, 1e-4),
                intensity=np.zeros(shape),
            )
        )
    return grids


def read_grid(path: Path) -> np.ndarray:
    """Return (rows, columns, 3) points in meters, NaN where nothing was measured."""
    lines = path.read_text(encoding='latin-1').splitlines()
    end = lines.index('end_header')
    head = {
        tuple(line.split()[:2]): line.split()[2] for line in lines[2:end] if len(line.split()) > 2
    }
    rows, columns = (int(head['obj_info', name]) for name in ('num_rows', 'num_cols'))
    count = int(head['element', 'vertex'])
    body = lines[end + 1 :]
    vertices = np.array([line.split()[:3] for line in body[:count]], dtype=np.float64)
    grid = np.full((rows * columns, 3), np.nan)
    for place, line in enumerate(body[count : count + rows * columns]):
        words = line.split()
        if words[0] == '1':
            grid[place] = vertices[int(words[1])]
    return grid.reshape(rows, columns, 3)
