# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads back the binary STL files that ``export`` writes, whose header tells their unit."""

from pathlib import Path
import re

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_FACE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
_HEADER = 80


def read_own_stl(path: Path) -> tuple[Floats, Ints]:
    """
    Read a mesh that this program wrote.

    :returns: (n, 3) vertices in metres, each once, and (m, 3) faces
    :raises FileError: it cannot be read, is no binary STL, or does not tell its unit
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    start = _HEADER + 4
    count = int.from_bytes(data[_HEADER:start], 'little')
    if len(data) < start or len(data) != start + count * _FACE.itemsize:
        raise FileError(f'{path}: is no binary STL file, or is cut off')
    unit = re.search(rb'unit (\w+)', data[:_HEADER])
    if unit is None or unit.group(1).decode() not in UNITS:
        raise FileError(f'{path}: its header does not tell its unit')
    corners = np.frombuffer(data, dtype=_FACE, offset=start)['corners'].reshape(-1, 3)
    # corners of one vertex were written from the same number, so that they are equal to the bit
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    metres = vertices.astype(np.float64) / UNITS[unit.group(1).decode()]
    return metres, faces.reshape(-1, 3).astype(np.int64)
