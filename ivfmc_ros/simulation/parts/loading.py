# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closed triangle meshes to scan, read from STL, and the platter."""

from dataclasses import dataclass
import math
from pathlib import Path
from typing import Literal

import numpy as np

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

Unit = Literal['m', 'mm', 'inch']

_METRES = {'m': 1.0, 'mm': 1e-3, 'inch': 0.0254}


@dataclass(frozen=True, eq=False, kw_only=True)
class Platter:
    """
    The disc of the turntable, its upper face at z = 0 of ``turntable``.

    radius : meters
    reflectance : 1 is white
    """

    radius: float = 0.1
    reflectance: float = 0.4

    def __post_init__(self) -> None:
        require_in_range('platter: radius', self.radius, 0.0, math.inf, 'm', open_low=True)
        require_in_range('platter: reflectance', self.reflectance, 0.0, 1.0)


DEFAULT_PLATTER = Platter()


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid:
    """
    A solid bounded by a closed triangle mesh.

    vertices_xyz : (n, 3) float64, meters, frame ``turntable``
    faces : (m, 3) int64, counter-clockwise seen from outside
    """

    vertices_xyz: Floats
    faces: Ints

    def __post_init__(self) -> None:
        if self.vertices_xyz.ndim != 2 or self.vertices_xyz.shape[1] != 3:
            raise ValueError(f'vertices_xyz has shape {self.vertices_xyz.shape}, expected (n, 3)')
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or not len(self.faces):
            raise ValueError(f'faces has shape {self.faces.shape}, expected (m, 3) with m > 0')

    @property
    def corners_xyz(self) -> Floats:
        """(m, 3, 3) meters: the corners of every face."""
        return np.asarray(self.vertices_xyz[self.faces])

    @property
    def normals(self) -> Floats:
        """(m, 3) outward unit normals of the faces; NaN where a face has no area."""
        a, b, c = self.corners_xyz.transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        with np.errstate(invalid='ignore'):
            return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    @property
    def volume(self) -> float:
        """Cubic meters; negative where the faces point inward."""
        a, b, c = self.corners_xyz.transpose(1, 0, 2)
        return float(np.einsum('ij,ij->', a, np.cross(b, c)) / 6)

    @property
    def watertight(self) -> bool:
        """Whether every edge belongs to two faces with opposite directions."""
        edges = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        forward = edges[:, 0] * len(self.vertices_xyz) + edges[:, 1]
        backward = edges[:, 1] * len(self.vertices_xyz) + edges[:, 0]
        once = len(np.unique(forward)) == len(forward)
        return bool(once and np.array_equal(np.sort(forward), np.sort(backward)))

    def moved(self, turntable_from_solid: Floats) -> 'Solid':
        """Return the solid transformed by a rigid (4, 4) matrix, meters."""
        rotated = self.vertices_xyz @ turntable_from_solid[:3, :3].T
        return Solid(vertices_xyz=rotated + turntable_from_solid[:3, 3], faces=self.faces)


def load_stl(path: Path, unit: Unit) -> Solid:
    """
    Read an STL file, whose format does not store a unit.

    unit : of the file
    returns : the solid in meters
    :raises FileError: the file cannot be read or is not an STL file
    :raises GeometryError: the triangles do not enclose a solid
    """
    import open3d  # takes seconds

    require_one_of('unit', unit, _METRES)
    if path.suffix.lower() != '.stl':
        raise FileError(f'{path}: is no STL file (its name must end with .stl)')
    if not path.is_file():
        raise FileError(f'{path}: there is no such file')
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    if not len(mesh.triangles):
        raise FileError(f'{path}: holds no triangles, or is no STL file')
    # STL repeats the vertices of every triangle
    mesh.remove_duplicated_vertices()
    vertices = np.asarray(mesh.vertices, dtype=np.float64) * _METRES[unit]
    solid = Solid(vertices_xyz=vertices, faces=np.asarray(mesh.triangles, dtype=np.int64))
    _require_closed(solid, path)
    return solid


def _require_closed(solid: Solid, path: Path) -> None:
    if not np.isfinite(solid.vertices_xyz).all():
        raise GeometryError(f'{path}: has coordinates that are not numbers')
    if not solid.watertight:
        raise GeometryError(f'{path}: the triangles do not close; repair the file in CAD')
    if solid.volume <= 0:
        raise GeometryError(f'{path}: the triangles face inward; repair the file in CAD')
