# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Uncertainty of the vertices of a mesh file: properties of a PLY file, or a file beside an STL file.

``mesh.stl.npz`` belongs to ``mesh.stl``. It holds, in the unit of the STL file, ``sigma`` and
``systematic`` (n,) of the vertices, ``kind`` and the vertex numbers ``faces`` (m, 3) of the
triangles in the order of the STL file, and the SHA-256 checksum of the STL file, so that it is
used for no other.
"""

import hashlib
from pathlib import Path
import zipfile

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros import files
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

SIDECAR_SUFFIX = '.npz'
_NAMES = ('sigma', 'systematic')
_PLY_TYPES = {'float': '<f4', 'double': '<f8', 'uchar': 'u1', 'int': '<i4', 'uint': '<u4'}

Stated = tuple[Floats | None, Floats | None]


def sidecar_of(path: Path) -> Path:
    """Return the path of the file with the uncertainties of an STL file."""
    return path.with_name(path.name + SIDECAR_SUFFIX)


def write_sidecar(path: Path, mesh: Mesh, scale: float) -> None:
    """
    Write the file beside the STL file ``path``, which was written from ``mesh`` before.

    scale : units of the STL file in a meter
    :raises FileError: the file cannot be written
    """
    unknown = np.full(len(mesh.vertices_xyz), np.nan)
    kind = np.full(len(mesh.faces), MEASURED, dtype=np.uint8) if mesh.kind is None else mesh.kind
    with files.atomic_file(sidecar_of(path)) as temporary, temporary.open('wb') as stream:
        # not compressed: that takes longer than all other files of a scan
        np.savez(
            stream,
            sha256=np.array(_checksum(path)),
            faces=mesh.faces.astype('<i4'),
            kind=kind,
            sigma=(mesh.sigma * scale).astype('<f4'),
            systematic=((unknown if mesh.systematic is None else mesh.systematic) * scale).astype(
                '<f4'
            ),
        )


def read_uncertainty(path: Path, triangles: Ints, count: int) -> Stated:
    """
    Return what a mesh file states of its vertices, (n,) in the file's unit, or None.

    triangles : (m, 3), as read from the file; count : n, number of vertices read
    returns : sigma of the noise, and sigma of the systematic error
    """
    suffix = path.suffix.lower()
    found: dict[str, Floats] = {}
    if suffix == '.ply':
        found = _ply_properties(path)
    elif suffix == '.stl' and sidecar_of(path).is_file():
        found = _of_sidecar(path, triangles, count)
    sigma, systematic = (found.get(name) for name in _NAMES)
    if sigma is None or len(sigma) != count:
        return None, None
    return sigma, systematic


def _ply_properties(path: Path) -> dict[str, Floats]:
    head, end, body = path.read_bytes().partition(b'end_header\n')
    if not end or b'binary_little_endian' not in head:
        return {}
    vertex = head.partition(b'element vertex ')[2].partition(b'element face')[0]
    lines = vertex.decode('ascii', 'replace').splitlines()
    names, kinds = [], []
    for line in lines[1:]:
        words = line.split()
        if len(words) == 3 and words[0] == 'property' and words[1] in _PLY_TYPES:
            kinds.append(_PLY_TYPES[words[1]])
            names.append(words[2])
    if 'sigma' not in names or not lines[0].strip().isdigit():
        return {}
    row = np.dtype(list(zip(names, kinds, strict=True)))
    count = int(lines[0])
    if len(body) < count * row.itemsize:
        return {}
    table: NDArray[np.void] = np.frombuffer(body, row, count)
    return {name: np.asarray(table[name], np.float64) for name in _NAMES if name in names}


def _of_sidecar(path: Path, triangles: Ints, count: int) -> dict[str, Floats]:
    try:
        with np.load(sidecar_of(path), allow_pickle=False) as stored:
            if str(stored['sha256']) != _checksum(path):
                return {}
            faces = np.asarray(stored['faces'], dtype=np.int64)
            values = {name: np.asarray(stored[name], np.float64) for name in _NAMES}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        # a damaged file states nothing; the report says that no uncertainty is known
        return {}
    if faces.shape != triangles.shape or not len(faces):
        return {}
    spread = {name: np.full(count, np.nan) for name in _NAMES}
    for name, value in values.items():
        spread[name][triangles.ravel()] = value[faces.ravel()]
    return spread


def _checksum(path: Path) -> str:
    with path.open('rb') as stream:
        return hashlib.file_digest(stream, 'sha256').hexdigest()
