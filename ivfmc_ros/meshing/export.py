# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files. CAD has no unit in STL and OBJ, so it is written in the header or a comment."""

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing import normals
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Mesh

# metres -> unit
UNITS = {'m': 1.0, 'mm': 1e3, 'inch': 1.0 / 0.0254}

_STL_FACE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])


def write_mesh(path: Path, mesh: Mesh, unit: str = 'mm') -> None:
    """
    Write a mesh as binary STL, binary PLY or OBJ, by the suffix of ``path``.

    :raises ParameterError: unknown suffix or unit
    :raises FileError: the file cannot be written
    """
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise ParameterError(f'{path}: {path.suffix!r} is not one of {", ".join(_WRITERS)}')
    scale = _scale(unit)
    with files.whole_file(path) as temporary, temporary.open('wb') as stream:
        write(stream, mesh, mesh.vertices_xyz * scale, unit)


def write_solid(path: Path, vertices_xyz: Floats, faces: Ints, unit: str = 'mm') -> None:
    """Write triangles that were not measured, for example a nominal part, as ``write_mesh``."""
    nothing = np.full(len(vertices_xyz), np.nan)
    mesh = Mesh(
        vertices_xyz=vertices_xyz,
        faces=faces,
        normals=normals.of_vertices(vertices_xyz, faces),
        sigma=nothing,
        intensity=nothing,
    )
    write_mesh(path, mesh, unit)


def write_cloud(path: Path, points_xyz: Floats, sigma: Floats, unit: str = 'mm') -> None:
    """
    Write (n, 3) points with their (n,) 1 sigma, both metres, as binary PLY.

    :raises ParameterError: unknown unit
    :raises FileError: the file cannot be written
    """
    scale = _scale(unit)
    table = np.column_stack([points_xyz * scale, sigma * scale]).astype('<f4')
    with files.whole_file(path) as temporary, temporary.open('wb') as stream:
        stream.write(_ply_header(('x', 'y', 'z', 'sigma'), len(table), 0, unit))
        stream.write(table.tobytes())


def _scale(unit: str) -> float:
    if unit not in UNITS:
        raise ParameterError(f'export_unit: {unit!r} is not one of {", ".join(UNITS)}')
    return UNITS[unit]


def _stl(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    records = np.zeros(len(mesh.faces), dtype=_STL_FACE)
    records['normal'] = np.nan_to_num(normals.of_faces(vertices, mesh.faces))
    records['corners'] = vertices[mesh.faces]
    # readers take a file whose header begins with 'solid' for the text format
    stream.write(f'ivfmc_ros binary STL, unit {unit}'.encode().ljust(80))
    stream.write(np.array(len(records), dtype='<u4').tobytes())
    stream.write(records.tobytes())


def _ply(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    names = ('x', 'y', 'z', 'nx', 'ny', 'nz', 'sigma', 'intensity')
    scale = UNITS[unit]
    columns = (vertices, mesh.normals, mesh.sigma[:, None] * scale, mesh.intensity[:, None])
    table = np.concatenate(columns, axis=1).astype('<f4')
    faces = np.zeros(len(mesh.faces), dtype=[('count', 'u1'), ('corners', '<i4', 3)])
    faces['count'] = 3
    faces['corners'] = mesh.faces
    stream.write(_ply_header(names, len(vertices), len(faces), unit))
    stream.write(table.tobytes())
    stream.write(faces.tobytes())


def _ply_header(names: tuple[str, ...], vertices: int, faces: int, unit: str) -> bytes:
    lines = [
        'ply',
        'format binary_little_endian 1.0',
        f'comment ivfmc_ros, unit {unit}',
        f'element vertex {vertices}',
        *(f'property float {name}' for name in names),
    ]
    if faces:
        lines += [f'element face {faces}', 'property list uchar int vertex_indices']
    return ('\n'.join([*lines, 'end_header']) + '\n').encode()


def _obj(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    stream.write(f'# ivfmc_ros, unit {unit}\n'.encode())
    np.savetxt(stream, vertices, fmt='v %.7g %.7g %.7g')
    np.savetxt(stream, np.nan_to_num(mesh.normals), fmt='vn %.5g %.5g %.5g')
    faces = np.repeat(mesh.faces + 1, 2, axis=1)
    np.savetxt(stream, faces, fmt='f %d//%d %d//%d %d//%d')


_Writer = Callable[[BinaryIO, Mesh, Floats, str], None]
_WRITERS: dict[str, _Writer] = {'.stl': _stl, '.ply': _ply, '.obj': _obj}
