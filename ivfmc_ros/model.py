# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Data types passed between the stages: Frame, Profile, View, Poses and Mesh.

Units are meters, radians and nanoseconds; pixel (0, 0) is the center of the first pixel
(OpenCV's convention). Points are in the frame ``turntable``, which turns with the part.
Invalid points are NaN (REP 117).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Image = NDArray[np.uint8] | NDArray[np.uint16]
Kinds = NDArray[np.uint8]

# Origin of a triangle: measured surface; a bridge over a gap of a few voxels; the face that the
# part stands on; the filling of a hole.
MEASURED, BRIDGED, BASE, FILLED = 0, 1, 2, 3


def _require_shape(name: str, array: NDArray[Any], shape: Sequence[int | None]) -> None:
    """Raise ValueError unless ``array`` has ``shape`` (None stands for any length)."""
    matches = array.ndim == len(shape) and all(
        expected in (None, actual) for actual, expected in zip(array.shape, shape, strict=True)
    )
    if not matches:
        text = ', '.join('n' if size is None else str(size) for size in shape)
        raise ValueError(f'{name} has shape {array.shape}, expected ({text})')


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """
    One camera image with the table position and the laser at its exposure.

    image : (height, width) mono or (height, width, 3) BGR, uint8 or uint16
    stamp_ns : start of exposure, nanoseconds
    angle : table position in radians, positive counter-clockwise about +z
    laser : index of the laser that was on, in the order of the cell
    view : number of the view (sweep) that the image belongs to
    seq : running number of the profile in its scan, without gaps
    speed : reported table speed, radians per second; 0 at standstill
    dark : image with all lasers off at the same table angle, shape and type of ``image``; None if
        not taken
    bracket : images of other exposure times at the same table angle with the same laser, shape and
        type of ``image``; not together with ``dark``
    :raises ValueError: ``image``, ``dark`` or one of ``bracket`` has another shape or type
    """

    image: Image
    stamp_ns: int
    angle: float
    laser: int = 0
    view: int = 0
    seq: int = 0
    speed: float = 0.0
    dark: Image | None = None
    bracket: tuple[Image, ...] = ()

    def __post_init__(self) -> None:
        if not (self.image.ndim == 2 or (self.image.ndim == 3 and self.image.shape[2] == 3)):
            raise ValueError(f'image has shape {self.image.shape}, expected (h, w) or (h, w, 3)')
        if self.image.dtype not in (np.uint8, np.uint16):
            raise ValueError(f'image has pixels of {self.image.dtype}, expected uint8 or uint16')
        dark = self.dark
        if dark is not None and (dark.shape, dark.dtype) != (self.image.shape, self.image.dtype):
            raise ValueError(
                f'dark is {dark.shape} of {dark.dtype}, image {self.image.shape} of '
                f'{self.image.dtype}; they must have the same shape and type'
            )
        for other in self.bracket:
            if (other.shape, other.dtype) != (self.image.shape, self.image.dtype):
                raise ValueError(
                    f'an image of the bracket is {other.shape} of {other.dtype}, image '
                    f'{self.image.shape} of {self.image.dtype}; they must have the same shape and '
                    'type'
                )
        if self.bracket and dark is not None:
            raise ValueError('dark belongs to one exposure; a frame with a bracket has none')


@dataclass(frozen=True, eq=False, kw_only=True)
class Profile:
    """
    The triangulated laser stripe of one image: points on the part.

    points_xyz : (n, 3) float64, meters, frame ``turntable``
    intensity : (n,) float64, height of the stripe peak above the background, in DN
    sigma : (n,) float64, meters, 1 sigma along the error direction dX/du in the laser plane
    uv : (n, 2) float64, pixel (column, row) of the stripe center
    angle : radians; in continuous motion provisional until the table motion is fitted
    speed : reported table speed, radians per second; 0 at standstill
    color : (n, 3) uint8, RGB of the surface with the laser off; None if not known
    :raises ValueError: arrays of different length
    """

    points_xyz: Floats
    intensity: Floats
    sigma: Floats
    uv: Floats
    angle: float
    laser: int
    view: int
    seq: int
    stamp_ns: int
    speed: float = 0.0
    color: Bytes | None = None

    def __post_init__(self) -> None:
        count = len(self.points_xyz)
        _require_shape('points_xyz', self.points_xyz, (count, 3))
        _require_shape('intensity', self.intensity, (count,))
        _require_shape('sigma', self.sigma, (count,))
        _require_shape('uv', self.uv, (count, 2))
        if self.color is not None:
            _require_shape('color', self.color, (count, 3))

    def __len__(self) -> int:
        return len(self.points_xyz)

    def to_single_precision(self) -> 'Profile':
        """Return the profile rounded to single precision, as a PointCloud2 message carries it."""
        names = ('points_xyz', 'intensity', 'sigma', 'uv')
        single = {name: getattr(self, name).astype(np.float32) for name in names}
        return replace(
            self,
            **{name: values.astype(np.float64) for name, values in single.items()},
            angle=float(np.float32(self.angle)),
            speed=float(np.float32(self.speed)),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """
    One sweep of one laser as an organized point cloud: a row per stripe row, a column per profile.

    points_xyz : (rows, columns, 3) float64, meters, frame ``turntable``; NaN where invalid
    intensity, sigma : (rows, columns) float64, DN and meters; NaN where invalid
    uv : (rows, columns, 2) float64, pixel; NaN where invalid
    angles : (columns,) float64, radians, ascending
    seqs : (columns,) int64, ``Profile.seq`` of each column
    color : (rows, columns, 3) uint8, RGB, 0 where invalid; None if not known
    clamping : number of the clamping that the view was taken in, 0 in a single scan; views of
        merged scans have different ones
    :raises ValueError: arrays of different shape
    """

    number: int
    laser: int
    points_xyz: Floats
    intensity: Floats
    sigma: Floats
    uv: Floats
    angles: Floats
    seqs: Ints
    color: Bytes | None = None
    clamping: int = 0

    def __post_init__(self) -> None:
        _require_shape('points_xyz', self.points_xyz, (None, None, 3))
        rows, columns = self.points_xyz.shape[:2]
        _require_shape('intensity', self.intensity, (rows, columns))
        _require_shape('sigma', self.sigma, (rows, columns))
        _require_shape('uv', self.uv, (rows, columns, 2))
        _require_shape('angles', self.angles, (columns,))
        _require_shape('seqs', self.seqs, (columns,))
        if self.color is not None:
            _require_shape('color', self.color, (rows, columns, 3))

    @property
    def valid(self) -> Bools:
        """(rows, columns) bool, whether the point is valid."""
        return np.isfinite(self.points_xyz[..., 0])

    def cloud(self) -> Floats:
        """Return the valid points, (n, 3) float64, meters."""
        return self.points_xyz[self.valid]


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """
    Correction of each view's pose in the frame ``turntable``; identity keeps the table's pose.

    turntable_from_view : (views, 4, 4) float64, rigid; p_turntable = T @ p_view
    """

    turntable_from_view: Floats

    def __post_init__(self) -> None:
        _require_shape('turntable_from_view', self.turntable_from_view, (None, 4, 4))

    @classmethod
    def identity(cls, count: int) -> 'Poses':
        """Return ``count`` identity poses."""
        return cls(turntable_from_view=np.tile(np.eye(4), (count, 1, 1)))

    def __len__(self) -> int:
        return len(self.turntable_from_view)


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """
    Triangle mesh in the frame ``turntable``.

    vertices_xyz : (n, 3) float64, meters
    faces : (m, 3) int64, counter-clockwise seen from outside
    normals : (n, 3) float64, unit, outward; NaN at a vertex that no face uses
    sigma : (n,) float64, meters, 1 sigma of the vertex along its measuring direction
    intensity : (n,) float64, DN
    kind : (m,) uint8, MEASURED, BRIDGED, BASE or FILLED; None if all faces were measured
    systematic : (n,) float64, meters, 1 sigma of the error that neighboring vertices share, for
        example where an edge cuts the stripe; NaN or None where it is not known
    isolated_components : number of dropped connected components, small ones far from the rest
    decimation_deviation : meters, greatest distance from the mesh before decimation; 0.0 without
    :raises ValueError: arrays of different length
    """

    vertices_xyz: Floats
    faces: Ints
    normals: Floats
    sigma: Floats
    intensity: Floats
    kind: Kinds | None = None
    systematic: Floats | None = None
    isolated_components: int = 0
    decimation_deviation: float = 0.0

    def __post_init__(self) -> None:
        count = len(self.vertices_xyz)
        _require_shape('vertices_xyz', self.vertices_xyz, (count, 3))
        _require_shape('faces', self.faces, (None, 3))
        _require_shape('normals', self.normals, (count, 3))
        _require_shape('sigma', self.sigma, (count,))
        _require_shape('intensity', self.intensity, (count,))
        if self.systematic is not None:
            _require_shape('systematic', self.systematic, (count,))
        if self.kind is not None:
            _require_shape('kind', self.kind, (len(self.faces),))
