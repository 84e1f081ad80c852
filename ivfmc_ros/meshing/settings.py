# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of meshing; their docstring describes the ``mesh.*`` parameters of the nodes."""

from dataclasses import dataclass
from importlib.util import find_spec

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

METHODS = ('integrate', 'paper', 'poisson')
CLOSINGS = ('none', 'base', 'all')


@dataclass(frozen=True, kw_only=True)
class MeshSettings:
    """
    Settings of meshing. Lengths are meters.

    method : integrate (signed distance on voxels), paper (triangles between neighboring points,
        Ismail et al. 2007) or poisson (screened Poisson reconstruction, for comparison)
    max_edge : greatest edge of a triangle, and distance of neighboring points on one surface; None
        for 5 point spacings
    close : which unmeasured surface is added: none (only gaps of up to 2 voxels are bridged), base
        (also the standing face) or all (also holes, so that the mesh is closed)
    voxel : edge of a voxel of integrate and poisson; None for 0.6 point spacings with integrate
        and 1 point spacing with poisson
    smoothing : iterations of bilateral normal filtering; 0 for no smoothing
    decimate : greatest deviation of the decimated mesh from the full one; 0 for
        ``decimate_sigmas``
    decimate_sigmas : with method integrate the same, as a fraction of the median 1 sigma of the
        points, such as 0.25, and only until there are two faces a point; 0 for no decimation
    island : connected components with fewer triangles are dropped, and so are those with less than
        2 % of all triangles that are farther than 20 voxels from the rest
    floor : height of the platter in ``turntable``, where the standing face lies; None if the part
        does not stand on the platter
    """

    method: str = 'integrate'
    max_edge: float | None = None
    close: str = 'none'
    voxel: float | None = None
    smoothing: int = 6
    decimate: float = 0.0
    decimate_sigmas: float = 0.0
    island: int = 200
    floor: float | None = 0.0

    def __post_init__(self) -> None:
        require_one_of('method', self.method, METHODS)
        require_one_of('close', self.close, CLOSINGS)
        for name, value in (('max_edge', self.max_edge), ('voxel', self.voxel)):
            if value is not None:
                require_in_range(name, value, 0.0, 1.0, 'm', open_low=True)
        require_in_range('smoothing', self.smoothing, 0, 200, 'iterations')
        require_in_range('decimate', self.decimate, 0.0, 0.1, 'm')
        require_in_range('decimate_sigmas', self.decimate_sigmas, 0.0, 100.0)
        if (self.decimate or self.decimate_sigmas) and find_spec('fast_simplification') is None:
            raise ParameterError(
                'decimate: needs fast-simplification, which is not installed: '
                'pip install fast-simplification'
            )
        require_in_range('island', self.island, 0, 10_000_000, 'triangles')
        if self.floor is not None:
            require_in_range('floor', self.floor, -1.0, 1.0, 'm')
        if self.method == 'paper' and self.close != 'none':
            raise ParameterError(
                f'close: {self.close!r} is not available with method paper, which adds no '
                'surface; use close none or method integrate'
            )
