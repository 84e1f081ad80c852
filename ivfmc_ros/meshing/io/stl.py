# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the binary STL files that ``export`` writes, with the unit stated in their header."""

from pathlib import Path
import re

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_FACE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
_HEADER = 80  # bytes


def read_stl(path: Path) -> tuple[Floats, Ints]:
    """
    Read a binary STL file whose header states its unit.

    returns : (n, 3) float64 vertices in meters, duplicates merged; and (m, 3) int64 faces
    :raises FileError: the file cannot be read, is no binary STL file, or states no known unit
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    start = _HEADER + 4
    count = int.from_bytes(data[_HEADER:start], 'little')
    if len(data) < start or len(data) != start + count * _FACE.itemsize:
        raise FileError(f'{path}: is no binary STL file, or is truncated')
    unit = re.search(rb'unit (\w+)', data[:_HEADER])
    if unit is None or unit.group(1).decode() not in UNITS:
        raise FileError(f'{path}: the header states no unit (one of {", ".join(UNITS)})')
    corners = np.frombuffer(data, dtype=_FACE, offset=start)['corners'].reshape(-1, 3)
    # all corners of one vertex were written from the same value, and are equal to the bit
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    meters = vertices.astype(np.float64) / UNITS[unit.group(1).decode()]
    return meters, faces.reshape(-1, 3).astype(np.int64)
