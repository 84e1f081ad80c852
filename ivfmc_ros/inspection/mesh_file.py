# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of mesh files for inspection. Mesh files have no unit; the caller states it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import sys
import tempfile
from typing import Any
from typing import IO

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.file_kinds import kind_of_file
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_one_of

SUFFIXES = ('.stl', '.ply', '.obj', '.off', '.glb')
# Largest ratio of the diagonals of mesh and nominal; a scan lacks the face the part stands on.
_MAX_SIZE_RATIO = 1.6


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshBody:
    """
    A triangle mesh read from a file.

    vertices_xyz : (n, 3) meters; faces : (m, 3)
    closed : the mesh has no boundary edges
    sigma : (n,) meters, 1 sigma per vertex, of PLY files that have it; None otherwise
    """

    vertices_xyz: Floats
    faces: Ints
    closed: bool
    sigma: Floats | None = None

    @property
    def diagonal(self) -> float:
        """Diagonal of the axis-aligned bounding box, meters."""
        return float(np.linalg.norm(np.ptp(self.vertices_xyz, axis=0)))


def read_mesh(path: Path, unit: str) -> MeshBody:
    """
    Read a mesh file; vertices with equal coordinates are merged.

    :raises ParameterError: unknown unit
    :raises FileError: the file cannot be read, has an unknown format or no triangles
    :raises GeometryError: coordinates are not finite
    """
    require_one_of('unit', unit, UNITS)
    if path.suffix.lower() not in SUFFIXES:
        known = ', '.join(SUFFIXES)
        kind = kind_of_file(path)
        raise FileError(
            f'{path}: {f"is {kind}, no mesh" if kind else f"{path.suffix!r} is not a supported"}'
            f'{"" if kind else " mesh format"}; use one of {known}'
        )
    if not path.is_file():
        raise FileError(f'{path}: file not found')
    mesh, said = _read_triangles(path)
    if said or not len(mesh.triangles):
        reason = f'is damaged ({said})' if said else 'has no triangles'
        raise FileError(f'{path}: {reason}, or is not a valid {path.suffix} file')
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if not np.isfinite(vertices).all():
        raise GeometryError(f'{path}: has coordinates that are not finite')
    unique, first, index = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    sigma = read_sigma(path) if path.suffix.lower() == '.ply' else None
    if sigma is not None:
        sigma = sigma[first] / UNITS[unit] if len(sigma) == len(vertices) else None
    faces = index.reshape(-1)[np.asarray(mesh.triangles, dtype=np.int64)]
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    closed = not len(topology.boundary_edges(faces[~degenerate]))
    return MeshBody(
        vertices_xyz=unique / UNITS[unit], faces=faces[~degenerate], closed=closed, sigma=sigma
    )


def _read_triangles(path: Path) -> tuple[Any, str]:
    """
    Read a mesh by Open3D.

    Open3D chooses the format by the suffix in lower case only. Its PLY reader, RPly, prints what
    is wrong with a file and keeps what it read before that.

    returns : the mesh, and what the reader printed
    """
    import open3d as o3d

    suffix = path.suffix.lower()
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as printed:
        named = path
        if suffix != path.suffix:
            named = Path(folder) / f'mesh{suffix}'
            named.symlink_to(path.absolute())
        with _output_to(printed), o3d.utility.VerbosityContextManager(_quiet()):
            mesh = o3d.io.read_triangle_mesh(named)
        printed.seek(0)
        text = printed.read().decode('utf-8', 'replace')
    lines = (line.partition('RPly:')[2].strip() for line in text.splitlines())
    return mesh, '; '.join(line for line in lines if line)


def _quiet() -> Any:
    import open3d as o3d

    return o3d.utility.VerbosityLevel.Error


@contextmanager
def _output_to(stream: IO[bytes]) -> Iterator[None]:
    """Let the process print to a file: a C library writes to the descriptors of the process."""
    for output in (sys.stdout, sys.stderr):
        output.flush()
    kept = [os.dup(number) for number in (1, 2)]
    try:
        for number in (1, 2):
            os.dup2(stream.fileno(), number)
        yield
    finally:
        for number, handle in zip((1, 2), kept, strict=True):
            os.dup2(handle, number)
            os.close(handle)


def read_sigma(path: Path) -> Floats | None:
    """Return the vertex property ``sigma`` (n,) of a PLY file, in the file's unit, or None."""
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


def require_closed(body: MeshBody, path: Path) -> None:
    """:raises GeometryError: the nominal is not closed, so that distances have no sign."""
    if not body.closed:
        raise GeometryError(
            f'{path}: the mesh is not closed, so that deviations have no sign; repair it in CAD '
            'or export it as a solid'
        )


def require_similar_size(measured: MeshBody, nominal: MeshBody, path: Path, unit: str) -> None:
    """
    Check that mesh and nominal have about the same size.

    :raises GeometryError: they have not; the message suggests a unit if one fits
    """
    ratio = nominal.diagonal / measured.diagonal
    if 1.0 / _MAX_SIZE_RATIO < ratio < _MAX_SIZE_RATIO:
        return
    sizes = f'{nominal.diagonal * 1e3:.4g} mm across, the mesh {measured.diagonal * 1e3:.4g} mm'
    for other, scale in UNITS.items():
        rescaled = ratio * UNITS[unit] / scale
        if other != unit and 1.0 / _MAX_SIZE_RATIO < rescaled < _MAX_SIZE_RATIO:
            raise GeometryError(
                f'{path}: read in {unit} it is {sizes}; in {other} the sizes would agree: if '
                f'that is its unit, use --nominal-unit {other}'
            )
    raise GeometryError(f'{path}: read in {unit} it is {sizes}; the sizes agree in no unit')
