# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes meshes as STL, PLY, OBJ, binary glTF or 3MF, and point clouds as PLY.

STL, PLY and OBJ have no field for the unit of length: it is written in the header or a comment.
"""

from collections.abc import Callable
from collections.abc import Iterable
import json
from pathlib import Path
import struct
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros import files
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.io import threemf
from ivfmc_ros.meshing.io.stated_uncertainty import write_sidecar
from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.validation import require_one_of

# name -> units in a meter
UNITS = {'m': 1.0, 'mm': 1e3, 'inch': 1.0 / 0.0254}
_CHUNK = 1 << 15  # faces

_STL_FACE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])


def write_mesh(path: Path, mesh: Mesh, unit: str = 'mm') -> None:
    """
    Write a mesh as binary STL, binary PLY, OBJ, binary glTF or 3MF, by the suffix of ``path``.

    The file appears complete or not at all. glTF is always in meters. Beside an STL file with
    measured vertices, ``<name>.stl.npz`` states their uncertainty (``stated_uncertainty``).

    unit : unit of the other formats, one of ``UNITS``
    :raises ParameterError: the suffix or the unit is unknown, or lib3mf is not installed
    :raises FileError: the file cannot be written
    """
    suffix = path.suffix.lower()
    require_one_of(str(path), suffix, _WRITERS)
    write = _WRITERS[suffix]
    scale = _scale(unit)
    with files.atomic_file(path) as temporary, temporary.open('wb') as stream:
        write(stream, mesh, mesh.vertices_xyz * scale, unit)
    if suffix == '.stl' and np.isfinite(mesh.sigma).any():
        write_sidecar(path, mesh, scale)


def write_solid(path: Path, vertices_xyz: Floats, faces: Ints, unit: str = 'mm') -> None:
    """
    Write triangles without measured attributes, for example a nominal part.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, 3) int64
    unit, errors : as ``write_mesh``
    """
    unknown = np.full(len(vertices_xyz), np.nan)
    mesh = Mesh(
        vertices_xyz=vertices_xyz,
        faces=faces,
        normals=normals.vertex_normals(vertices_xyz, faces),
        sigma=unknown,
        intensity=unknown,
    )
    write_mesh(path, mesh, unit)


def write_cloud(path: Path, points_xyz: Floats, sigma: Floats, unit: str = 'mm') -> None:
    """
    Write points and their uncertainties as binary PLY.

    points_xyz : (n, 3) meters
    sigma : (n,) meters, 1 sigma
    unit : unit of the file, one of ``UNITS``
    :raises ParameterError: the unit is unknown
    :raises FileError: the file cannot be written
    """
    scale = _scale(unit)
    table = np.column_stack([points_xyz * scale, sigma * scale]).astype('<f4')
    with files.atomic_file(path) as temporary, temporary.open('wb') as stream:
        stream.write(_ply_header(('x', 'y', 'z', 'sigma'), len(table), 0, unit))
        stream.write(table.tobytes())


def _scale(unit: str) -> float:
    require_one_of('export_unit', unit, UNITS)
    return UNITS[unit]


def _stl(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    # a header that begins with 'solid' would mark the file as text
    stream.write(f'ivfmc_ros binary STL, unit {unit}'.encode().ljust(80))
    stream.write(np.array(len(mesh.faces), dtype='<u4').tobytes())

    def records(chunk: slice) -> bytes:
        faces = np.zeros(chunk.stop - chunk.start, dtype=_STL_FACE)
        faces['normal'] = np.nan_to_num(normals.face_normals(vertices, mesh.faces[chunk]))
        faces['corners'] = vertices.take(mesh.faces[chunk], axis=0)
        return faces.tobytes()

    for data in map_chunked(records, len(mesh.faces), _CHUNK):
        stream.write(data)


def _ply(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    table = np.zeros(len(vertices), dtype=[*((name, '<f4') for name in _PLY_FLOATS), *_COLORS])
    values = (*vertices.T, *mesh.normals.T, mesh.sigma * UNITS[unit], mesh.intensity)
    systematic = mesh.sigma * np.nan if mesh.systematic is None else mesh.systematic
    values = (*values, quality(mesh), systematic * UNITS[unit])
    for name, column in zip(_PLY_FLOATS, values, strict=True):
        table[name] = column
    for name, _ in _COLORS:
        table[name] = _gray(mesh)
    faces = np.zeros(
        len(mesh.faces), dtype=[('count', 'u1'), ('corners', '<i4', 3), ('kind', 'u1')]
    )
    faces['count'] = 3
    faces['corners'] = mesh.faces
    faces['kind'] = MEASURED if mesh.kind is None else mesh.kind
    stream.write(_ply_header(_PLY_FLOATS, len(vertices), len(faces), unit, colored=True))
    stream.write(table.tobytes())
    stream.write(faces.tobytes())


_PLY_FLOATS = ('x', 'y', 'z', 'nx', 'ny', 'nz', 'sigma', 'intensity', 'quality', 'systematic')
_COLORS = [('red', 'u1'), ('green', 'u1'), ('blue', 'u1')]


def quality(mesh: Mesh) -> Floats:
    """Return (n,) median sigma by sigma of each vertex, clipped to 1; 0 where not measured."""
    known = mesh.sigma[mesh.sigma > 0]
    median = float(np.median(known)) if len(known) else 1.0
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.asarray(np.nan_to_num(np.clip(median / mesh.sigma, 0.0, 1.0)))


def _gray(mesh: Mesh) -> NDArray[np.uint8]:
    """Return the intensity as gray values: the 99th percentile is white, 0 and NaN are black."""
    finite = mesh.intensity[np.isfinite(mesh.intensity)]
    top = max(float(np.percentile(finite, 99)), 1e-9) if len(finite) else 1.0
    return np.asarray(np.nan_to_num(np.clip(mesh.intensity / top, 0, 1)) * 255, dtype=np.uint8)


def _ply_header(
    names: tuple[str, ...], vertices: int, faces: int, unit: str, *, colored: bool = False
) -> bytes:
    lines = [
        'ply',
        'format binary_little_endian 1.0',
        f'comment ivfmc_ros, unit {unit}',
        'comment kind: 0 measured, 1 bridges a gap, 2 standing face, 3 fills a hole',
        f'element vertex {vertices}',
        *(f'property float {name}' for name in names),
    ]
    if colored:
        lines += [f'property uchar {name}' for name, _ in _COLORS]
    if faces:
        lines += [f'element face {faces}', 'property list uchar int vertex_indices']
        lines += ['property uchar kind']
    return ('\n'.join([*lines, 'end_header']) + '\n').encode()


def _obj(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    stream.write(f'# ivfmc_ros, unit {unit}\n'.encode())
    np.savetxt(stream, vertices, fmt='v %.7g %.7g %.7g')
    np.savetxt(stream, np.nan_to_num(mesh.normals), fmt='vn %.5g %.5g %.5g')
    faces = np.repeat(mesh.faces + 1, 2, axis=1)
    np.savetxt(stream, faces, fmt='f %d//%d %d//%d %d//%d')


def _glb(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    """Write binary glTF 2.0, which is in meters and has y up, whatever ``unit`` is."""
    del unit
    vertices = np.ascontiguousarray(mesh.vertices_xyz, dtype='<f4')
    parts = [
        vertices.tobytes(),
        np.nan_to_num(mesh.normals, nan=0.5773503).astype('<f4').tobytes(),
        mesh.faces.astype('<u4').tobytes(),
    ]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).tolist()
    accessors = [
        {'bufferView': 0, 'componentType': 5126, 'count': len(vertices), 'type': 'VEC3',
         'min': vertices.min(axis=0).tolist(), 'max': vertices.max(axis=0).tolist()},
        {'bufferView': 1, 'componentType': 5126, 'count': len(vertices), 'type': 'VEC3'},
        {'bufferView': 2, 'componentType': 5125, 'count': mesh.faces.size, 'type': 'SCALAR'},
    ]  # fmt: skip
    document = {
        'asset': {'version': '2.0', 'generator': 'ivfmc_ros, unit m'},
        'scene': 0,
        'scenes': [{'nodes': [0]}],
        'nodes': [{'mesh': 0, 'rotation': [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]}],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0, 'NORMAL': 1}, 'indices': 2}]}],
        'accessors': accessors,
        'bufferViews': [
            {'buffer': 0, 'byteOffset': start, 'byteLength': len(part)}
            for start, part in zip(starts, parts, strict=False)
        ],
        'buffers': [{'byteLength': starts[-1]}],
    }
    head = json.dumps(document).encode()
    head += b' ' * (-len(head) % 4)
    total = 12 + 8 + len(head) + 8 + starts[-1]
    stream.write(b'glTF' + struct.pack('<II', 2, total))
    stream.write(struct.pack('<I', len(head)) + b'JSON' + head)
    stream.write(struct.pack('<I', starts[-1]) + b'BIN\0')
    for part in parts:
        stream.write(part)


_Writer = Callable[[BinaryIO, Mesh, Floats, str], None]
_WRITERS: dict[str, _Writer] = {
    '.stl': _stl, '.ply': _ply, '.obj': _obj, '.glb': _glb, '.3mf': threemf.write,
}  # fmt: skip
FORMATS = tuple(suffix[1:] for suffix in _WRITERS)


def require_formats(names: Iterable[str]) -> None:
    """
    Check that meshes can be written in formats.

    :raises ParameterError: a name is not in ``FORMATS``, or its library is not installed
    """
    for name in names:
        require_one_of('formats', name, FORMATS)
        if name == '3mf':
            threemf.require()
