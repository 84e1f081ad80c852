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
from ivfmc_ros.meshing.io.stated_uncertainty import read_uncertainty
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_one_of

SUFFIXES = ('.stl', '.ply', '.obj', '.off', '.glb')
# Largest ratio of the diagonals of mesh and nominal; a scan lacks the face the part stands on.
_MAX_SIZE_RATIO = 1.6
# Diagonals of parts that a laser stripe measures, meters.
_PART_SIZE = (0.005, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshBody:
    """
    A triangle mesh read from a file.

    vertices_xyz : (n, 3) meters; faces : (m, 3)
    closed : the mesh has no boundary edges
    sigma : (n,) meters, 1 sigma of the noise of each vertex; None if the file does not state it
    systematic : (n,) meters, 1 sigma of the error that neighboring vertices share, likewise
    gray : (n,) brightness of the vertices' colors, 0 to 255; None if the file has no colors
    """

    vertices_xyz: Floats
    faces: Ints
    closed: bool
    sigma: Floats | None = None
    systematic: Floats | None = None
    gray: Floats | None = None

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
    faces = index.reshape(-1)[np.asarray(mesh.triangles, dtype=np.int64)]
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    closed = not len(topology.boundary_edges(faces[~degenerate]))
    stated = read_uncertainty(path, np.asarray(mesh.triangles, dtype=np.int64), len(vertices))
    sigma, systematic = (None if u is None else u[first] / UNITS[unit] for u in stated)
    return MeshBody(
        vertices_xyz=unique / UNITS[unit],
        faces=faces[~degenerate],
        closed=closed,
        sigma=sigma,
        systematic=systematic,
        gray=_gray(mesh, first),
    )


def _gray(mesh: Any, first: Ints) -> Floats | None:
    """Return the brightness of the vertices ``first``, None where the file has no colors."""
    if not mesh.has_vertex_colors():
        return None
    colors = np.asarray(mesh.vertex_colors, dtype=np.float64)
    return np.asarray(255.0 * colors[first].mean(axis=1))


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


def require_closed(body: MeshBody, path: Path) -> None:
    """:raises GeometryError: the nominal is not closed, so that distances have no sign."""
    if not body.closed:
        raise GeometryError(
            f'{path}: the mesh is not closed, so that deviations have no sign; repair it in CAD '
            'or export it as a solid'
        )


def require_similar_size(
    measured: MeshBody,
    nominal: MeshBody,
    paths: tuple[Path, Path],
    units: tuple[str, str],
) -> None:
    """
    Check that mesh and nominal have about the same size.

    paths, units : of the mesh and of the nominal, as they were read
    :raises GeometryError: they have not; the message names the units that would fit
    """
    ratio = nominal.diagonal / measured.diagonal
    if 1.0 / _MAX_SIZE_RATIO < ratio < _MAX_SIZE_RATIO:
        return
    sizes = (
        f'{paths[0]} is {measured.diagonal * 1e3:.4g} mm across if it is in {units[0]}, '
        f'{paths[1]} is {nominal.diagonal * 1e3:.4g} mm if it is in {units[1]}'
    )
    advice = [
        *_fitting_units(1.0 / ratio, '--unit', paths[0], units[0], measured.diagonal),
        *_fitting_units(ratio, '--nominal-unit', paths[1], units[1], nominal.diagonal),
    ]
    if not advice:
        raise GeometryError(f'{sizes}; the sizes agree in no unit')
    # a part is rather between 5 mm and 1 m across than not
    plausible = [text for text, size in advice if _PART_SIZE[0] < size < _PART_SIZE[1]]
    texts = plausible or [text for text, _ in advice]
    raise GeometryError(f'{sizes}; the sizes would agree with {", or with ".join(texts)}')


def _fitting_units(
    ratio: float, option: str, path: Path, unit: str, diagonal: float
) -> Iterator[tuple[str, float]]:
    """Yield the option that makes a file fit, and how large the part is then, meters."""
    for other, scale in UNITS.items():
        factor = UNITS[unit] / scale
        if other != unit and 1.0 / _MAX_SIZE_RATIO < ratio * factor < _MAX_SIZE_RATIO:
            yield f'{option} {other}, the unit of {path.name}', diagonal * factor
