# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Points in doubt are moved along their rays onto the surface around them.

Where an edge or a shadow cuts the stripe, the middle of what is left is not the middle of the
sheet of light, and the point that is triangulated there lies off the surface. The pixel does see
the surface, though: the true point lies on its ray, and not farther along it than the light is
thick. So where most of the points around make a plane, it is where the ray meets that plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.meshing.samples.planes import Around
from ivfmc_ros.meshing.samples.planes import Planes
from ivfmc_ros.meshing.samples.planes import planes_at
from ivfmc_ros.meshing.samples.stripe_end_rejection import cut_ends
from ivfmc_ros.meshing.samples.stripe_end_rejection import run_ends
from ivfmc_ros.meshing.samples.surface_samples import links
from ivfmc_ros.meshing.samples.surface_samples import RangeGrid
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# A point of so many usual sigmas is in doubt, and so is the end of a stripe.
_DOUBTFUL = 1.6
# 1 sigma by which an end that looks well may be off, usual sigmas
_END_BIAS = 2.0
# Farther from the plane, a point that was not cut lies on something else: usual sigmas for an
# end, its own for one in doubt.
_MOST_OFF_END, _MOST_OFF = 4.0, 1.5
_NEIGHBOURS, _REACH, _SCALE = 25, 6.0, 2.1  # count; voxels
_IN_PLANE = 2.0  # sigmas
_LEAST_SHARE, _LEAST_MEMBERS, _BROAD = 0.65, 6, 0.6
_MOST_SPREAD = 0.6
# A point so far from a plane (sigmas) may lie on another face; then nearly all have to agree.
_FAR, _LEAST_SHARE_FAR = 4.0, 0.9
_LEAST_FACING = 0.2
# The light of a sheet is within so many of its sigmas; sigma of a point is a tenth of that of
# the stripe, where the cell does not say how thick the sheet is.
_LIGHT, _WIDTH = 2.0, 10.0
_LEAST_SIGMA = 0.7  # of a point on a plane of others, usual sigmas


@dataclass(frozen=True, eq=False, kw_only=True)
class Stripes:
    """
    The points of a view by what is in doubt about them, (rows, columns) bool each.

    cut : at the end of a stripe and not on its line
    outer : of these, those with nothing behind them
    end : the last of a stripe; unsure : of a large sigma
    """

    grid: RangeGrid
    cut: Bools
    outer: Bools
    end: Bools
    unsure: Bools

    @classmethod
    def of(cls, grid: RangeGrid, reach: float | None, sigma: float) -> 'Stripes':
        """Tell what is in doubt; sigma (metres) is that of a usual point."""
        points = grid.points_xyz
        down = links(grid, 0, reach)
        cut = cut_ends(points, down, sigma)
        left = np.isfinite(points[..., 0]) & ~cut
        end = run_ends(left, down)
        with np.errstate(invalid='ignore'):
            unsure = left & ~end & (grid.sigma > _DOUBTFUL * sigma)
        outer = cut & run_ends(np.isfinite(points[..., 0]), down)
        return cls(grid=grid, cut=cut, outer=outer, end=end, unsure=unsure)

    @property
    def known(self) -> Floats:
        """The points that tell of the surface, (n, 3)."""
        points = self.grid.points_xyz
        return points[np.isfinite(points[..., 0]) & ~self.outer]


def settled(
    stripes: Sequence[Stripes], sigma: float, voxel: float
) -> tuple[list[RangeGrid], Floats]:
    """
    Return the grids with points in doubt where their rays meet the surface.

    Cut ends around which most points make no plane are left out; others stay as they are.

    sigma : metres, of a usual point
    returns : the grids, and (n, 3) what was left out and has a point behind it
    """
    around = Around(
        points_xyz=np.concatenate([each.known for each in stripes]),
        count=_NEIGHBOURS,
        reach=_REACH * voxel,
        scale=_SCALE * voxel,
    )
    grids = [_settled(each, around, sigma, voxel) for each in stripes]
    left_out = [
        each.grid.points_xyz[each.cut & ~each.outer & np.isnan(grid.points_xyz[..., 0])]
        for each, grid in zip(stripes, grids, strict=True)
    ]
    return grids, np.concatenate(left_out)


def _settled(stripes: Stripes, around: Around, sigma: float, voxel: float) -> RangeGrid:
    grid = stripes.grid
    place = np.nonzero(stripes.cut | stripes.end | stripes.unsure)
    points = grid.points_xyz.copy()
    points[stripes.cut] = np.nan
    if not len(place[0]) or not len(around.points_xyz):
        return replace(grid, points_xyz=points)
    asked = grid.points_xyz[place]
    sight = np.broadcast_to(grid.sight, points.shape)[place]
    planes = planes_at(asked, around, _IN_PLANE * sigma, voxel, through=False)
    facing = (planes.normals * sight).sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        along = np.nan_to_num(-planes.height / facing)
    cut, end = stripes.cut[place], stripes.end[place]
    own = np.hypot(grid.sigma[place], np.where(end, _END_BIAS * sigma, 0.0))
    spread = np.maximum(planes.spread, 1e-3) * sigma
    most = np.where(end, _MOST_OFF_END * sigma, _MOST_OFF * grid.sigma[place])
    good = _sound(planes, sigma, voxel) & (np.abs(facing) > _LEAST_FACING)
    good &= _in_light(grid, place, along, sigma)
    good &= cut | (np.abs(planes.height) < most)
    # of a cut end nothing but its ray is known
    share = np.where(cut, 1.0, own**2 / (own**2 + spread**2))
    chosen = tuple(index[good] for index in place)
    points[chosen] = (asked + (share * along)[:, None] * sight)[good]
    known = np.where(cut, spread, np.sqrt(share) * spread)
    new_sigma = grid.sigma.copy()
    new_sigma[chosen] = np.maximum(known, _LEAST_SIGMA * sigma)[good]
    return replace(grid, points_xyz=points, sigma=new_sigma)


def _sound(planes: Planes, sigma: float, voxel: float) -> Bools:
    far = np.abs(planes.height) > _FAR * sigma
    return np.asarray(
        (planes.share > np.where(far, _LEAST_SHARE_FAR, _LEAST_SHARE))
        & (planes.members >= _LEAST_MEMBERS)
        & (planes.breadth > _BROAD * voxel)
        & (planes.spread < _MOST_SPREAD)
    )


def _in_light(
    grid: RangeGrid, place: tuple[np.ndarray, ...], along: Floats, sigma: float
) -> Bools:
    """Tell which points are still in the sheet of light after a way along their rays."""
    way = np.abs(along)
    if grid.error is not None:
        sight = np.broadcast_to(grid.sight, grid.points_xyz.shape)[place]
        error = np.broadcast_to(grid.error, grid.points_xyz.shape)[place]
        way = way * np.linalg.norm(np.cross(sight, error), axis=1)
    return np.asarray(way < _LIGHT * (grid.thickness or _WIDTH * sigma))
