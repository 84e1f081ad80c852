# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files to inspect and to compare with. A mesh file names no unit; the caller has to."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_one_of

SUFFIXES = ('.stl', '.ply', '.obj', '.off', '.glb')
# Sizes of one part agree within this factor, though a scan has no standing face.
_ALIKE = 1.6


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """
    Triangles of a file: vertices_xyz (n, 3) metres, faces (m, 3), and whether they close.

    sigma : (n,) metres, if the file has it (a PLY written here), or None
    """

    vertices_xyz: Floats
    faces: Ints
    closed: bool
    sigma: Floats | None = None

    @property
    def diagonal(self) -> float:
        """Metres, of the box along the axes."""
        return float(np.linalg.norm(np.ptp(self.vertices_xyz, axis=0)))


def read_body(path: Path, unit: str) -> Body:
    """
    Read a mesh file; corners at one place become one vertex.

    :raises ParameterError: unknown unit
    :raises FileError: the file cannot be read, or holds no triangles
    :raises GeometryError: it has coordinates that are not numbers
    """
    import open3d as o3d

    require_one_of('unit', unit, UNITS)
    if path.suffix.lower() not in SUFFIXES:
        known = ', '.join(SUFFIXES)
        raise FileError(f'{path}: {path.suffix!r} is no mesh format known here; use {known}')
    if not path.is_file():
        raise FileError(f'{path}: there is no such file')
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(path)
    if not len(mesh.triangles):
        raise FileError(f'{path}: holds no triangles, or is no {path.suffix} file')
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if not np.isfinite(vertices).all():
        raise GeometryError(f'{path}: has coordinates that are not numbers')
    unique, first, index = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    sigma = read_sigma(path) if path.suffix.lower() == '.ply' else None
    if sigma is not None:
        sigma = sigma[first] / UNITS[unit] if len(sigma) == len(vertices) else None
    faces = index.reshape(-1)[np.asarray(mesh.triangles, dtype=np.int64)]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    closed = not len(topology.boundary_edges(faces[~flat]))
    return Body(vertices_xyz=unique / UNITS[unit], faces=faces[~flat], closed=closed, sigma=sigma)


def read_sigma(path: Path) -> Floats | None:
    """Return (n,) sigma in the unit of a PLY file's positions, if it has floats of that name."""
    head, end, body = path.read_bytes().partition(b'end_header\n')
    if not end or b'binary_little_endian' not in head:
        return None
    vertex = head.partition(b'element vertex ')[2].partition(b'element face')[0]
    lines = vertex.decode('ascii', 'replace').splitlines()
    names, kinds = [], []
    for line in lines[1:]:
        words = line.split()
        if len(words) == 3 and words[0] == 'property' and words[1] in _PLY_TYPES:
            kinds.append(_PLY_TYPES[words[1]])
            names.append(words[2])
    if 'sigma' not in names or not lines[0].strip().isdigit():
        return None
    row = np.dtype(list(zip(names, kinds, strict=True)))
    count = int(lines[0])
    if len(body) < count * row.itemsize:
        return None
    return np.asarray(np.frombuffer(body, row, count)['sigma'], dtype=np.float64)


_PLY_TYPES = {'float': '<f4', 'double': '<f8', 'uchar': 'u1', 'int': '<i4', 'uint': '<u4'}


def require_closed(body: Body, path: Path) -> None:
    """:raises GeometryError: the nominal has holes, so that inside and outside are not defined."""
    if not body.closed:
        raise GeometryError(
            f'{path}: the triangles do not close, so that it has no inside; repair the file in '
            'CAD (an open nominal gives no sign of a deviation)'
        )


def require_alike(measured: Body, nominal: Body, path: Path, unit: str) -> None:
    """
    Check that both are about as large.

    :raises GeometryError: they are not; the message names the unit that would explain it
    """
    ratio = nominal.diagonal / measured.diagonal
    if 1.0 / _ALIKE < ratio < _ALIKE:
        return
    sizes = f'{nominal.diagonal * 1e3:.4g} mm across, the mesh {measured.diagonal * 1e3:.4g} mm'
    for other, scale in UNITS.items():
        rescaled = ratio * UNITS[unit] / scale
        if other != unit and 1.0 / _ALIKE < rescaled < _ALIKE:
            raise GeometryError(
                f'{path}: read in {unit} it is {sizes}; in {other} they would be alike: if that '
                f'is its unit, say so (--nominal-unit {other})'
            )
    raise GeometryError(f'{path}: read in {unit} it is {sizes}; no unit makes them alike')
