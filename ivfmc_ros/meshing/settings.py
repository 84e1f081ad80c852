# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How views become a mesh."""

from dataclasses import dataclass

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

METHODS = ('integrate', 'paper', 'poisson')
CLOSINGS = ('none', 'base', 'all')


@dataclass(frozen=True, kw_only=True)
class MeshSettings:
    """
    How views become a mesh. Lengths are metres.

    method : integrate (a signed distance on voxels), paper (triangles between neighbours, after
        Ismail et al. 2007) or poisson (screened Poisson, for comparison)
    max_edge : the paper's threshold on a triangle's edges: neighbours farther apart are not one
        surface; None for 5 point spacings
    close : what may be invented where nothing was seen: none (but gaps of up to 2 voxels are
        bridged), base (the standing face), all
    voxel : edge of a voxel of integrate and poisson; None for 0.6 of the spacing of the points, of
        poisson for all of it
    smoothing : rounds of bilateral normal filtering; 0 leaves the noise in
    decimate : how far the simplified mesh may be from the full one; 0 keeps all triangles
    island : a piece of surface with fewer triangles is dropped, and so is one of less than 2 % of
        all that is farther than 20 voxels from the rest
    floor : height of the platter in ``turntable``, on which the standing face lies; None if the
        part does not stand on one
    """

    method: str = 'integrate'
    max_edge: float | None = None
    close: str = 'none'
    voxel: float | None = None
    smoothing: int = 6
    decimate: float = 0.0
    island: int = 200
    floor: float | None = 0.0

    def __post_init__(self) -> None:
        require_one_of('method', self.method, METHODS)
        require_one_of('close', self.close, CLOSINGS)
        for name, value in (('max_edge', self.max_edge), ('voxel', self.voxel)):
            if value is not None:
                require_in_range(name, value, 0.0, 1.0, 'm', open_low=True)
        require_in_range('smoothing', self.smoothing, 0, 200, 'rounds')
        require_in_range('decimate', self.decimate, 0.0, 0.1, 'm')
        require_in_range('island', self.island, 0, 10_000_000, 'triangles')
        if self.floor is not None:
            require_in_range('floor', self.floor, -1.0, 1.0, 'm')
        if self.method == 'paper' and self.close != 'none':
            raise ParameterError('close: the paper invents no surface; use method integrate')
