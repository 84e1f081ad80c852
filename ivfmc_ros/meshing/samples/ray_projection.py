# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Correction of uncertain points: each is moved along its camera ray onto the surface around it.

Where an edge or a shadow truncates the stripe, the center of what remains is not the center of
the light sheet, and the point triangulated from it lies off the surface. The true point does lie
on the camera ray, within the thickness of the light sheet. Where most neighbors of the point are
in one plane, the point is moved to the intersection of its ray with that plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.meshing.parallel import map_chunked
from ivfmc_ros.meshing.samples.plane_bias import height_over_planes
from ivfmc_ros.meshing.samples.planes import fit_planes
from ivfmc_ros.meshing.samples.planes import LocalPlanes
from ivfmc_ros.meshing.samples.planes import Neighborhood
from ivfmc_ros.meshing.samples.range_grid import connected_to_next
from ivfmc_ros.meshing.samples.range_grid import RangeGrid
from ivfmc_ros.meshing.samples.stripe_end_rejection import run_ends
from ivfmc_ros.meshing.samples.stripe_end_rejection import truncated_ends
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# "Sigma" without a point is the median 1 sigma of all points. A point with more than this many is
# uncertain.
_UNCERTAIN_SIGMAS = 1.6
# 1 sigma of the bias of a stripe end that is not truncated visibly, sigmas.
_END_BIAS = 2.0
# Greatest height over the plane of points that belong to it: of a stripe end in sigmas, of an
# uncertain point in its own sigmas.
_MAX_END_HEIGHT, _MAX_UNCERTAIN_HEIGHT = 4.0, 1.5
_MAX_NEIGHBORS = 25
_SEARCH_RADIUS, _DISTANCE_SIGMA = 6.0, 2.1  # voxels
_INLIER_SIGMAS = 2.0
# Least share and number of inliers of a plane, and their least breadth in voxels.
_MIN_INLIER_RATIO, _MIN_INLIERS, _MIN_BREADTH = 0.65, 6, 0.6
_MAX_HEIGHT_SIGMA = 0.6  # of the plane, in units of 1 sigma of an inlier
# A point higher over the plane (sigmas) may lie on another face, unless nearly all inliers agree.
_FAR_HEIGHT, _MIN_INLIER_RATIO_FAR = 4.0, 0.9
_MIN_FACING = 0.2  # cosine between plane normal and ray
# Half thickness of the light sheet in its sigmas; and the sigma of an unknown sheet in units of
# that of a point, because peaks are located to about a tenth of the stripe's width.
_SHEET_SIGMAS, _SHEET_PER_POINT_SIGMA = 2.0, 10.0
_MIN_SIGMA = 0.7  # of a projected point, sigmas


@dataclass(frozen=True, eq=False, kw_only=True)
class ClassifiedGrid:
    """
    A range grid and which of its points are uncertain, (rows, columns) bool each.

    max_edge : meters, greatest distance of neighbors; None for 6 median spacings only
    truncated : at the end of a stripe and not on its line
    without_run : of these, those with no connected point before them
    end : last of a stripe, not truncated
    uncertain : of a large sigma, and none of the above
    """

    grid: RangeGrid
    max_edge: float | None
    truncated: Bools
    without_run: Bools
    end: Bools
    uncertain: Bools

    @classmethod
    def of(cls, grid: RangeGrid, max_edge: float | None, sigma: float) -> 'ClassifiedGrid':
        """
        Classify the points of a grid.

        max_edge : meters, greatest distance of neighbors; None for 6 median spacings only
        sigma : meters, median 1 sigma of all points
        """
        points = grid.points_xyz
        down = connected_to_next(grid, 0, max_edge)
        truncated = truncated_ends(points, down, sigma)
        left = np.isfinite(points[..., 0]) & ~truncated
        end = run_ends(left, down)
        with np.errstate(invalid='ignore'):
            uncertain = left & ~end & (grid.sigma > _UNCERTAIN_SIGMAS * sigma)
        without_run = truncated & run_ends(np.isfinite(points[..., 0]), down)
        return cls(
            grid=grid,
            max_edge=max_edge,
            truncated=truncated,
            without_run=without_run,
            end=end,
            uncertain=uncertain,
        )

    @property
    def support_points(self) -> Floats:
        """Points from which planes are estimated, (n, 3) meters."""
        points = self.grid.points_xyz
        return points[np.isfinite(points[..., 0]) & ~self.without_run]


def project_uncertain_points(
    classified: Sequence[ClassifiedGrid], sigma: float, voxel: float
) -> tuple[list[RangeGrid], Floats]:
    """
    Return the grids with uncertain points moved along their rays onto the surface.

    Truncated ends whose neighbors are in no common plane become NaN; other points keep their
    place.

    sigma : meters, median 1 sigma of all points
    voxel : meters
    returns : the grids; and the dropped truncated ends with a connected point, (n, 3) meters
    """
    neighborhood = Neighborhood(
        points_xyz=np.concatenate([each.support_points for each in classified]),
        max_neighbors=_MAX_NEIGHBORS,
        radius=_SEARCH_RADIUS * voxel,
        distance_sigma=_DISTANCE_SIGMA * voxel,
    )
    grids = list(
        map_chunked(
            lambda one: _projected(classified[one.start], neighborhood, sigma, voxel),
            len(classified),
            1,
        )
    )
    dropped = [
        each.grid.points_xyz[
            each.truncated & ~each.without_run & np.isnan(grid.points_xyz[..., 0])
        ]
        for each, grid in zip(classified, grids, strict=True)
    ]
    return grids, np.concatenate(dropped)


def _projected(
    classified: ClassifiedGrid, neighborhood: Neighborhood, sigma: float, voxel: float
) -> RangeGrid:
    grid = classified.grid
    place = np.nonzero(classified.truncated | classified.end | classified.uncertain)
    points = grid.points_xyz.copy()
    points[classified.truncated] = np.nan
    if not len(place[0]) or not len(neighborhood.points_xyz):
        return replace(grid, points_xyz=points)
    queries = grid.points_xyz[place]
    to_camera = np.broadcast_to(grid.to_camera, points.shape)[place]
    tolerance = _INLIER_SIGMAS * sigma
    planes = fit_planes(queries, neighborhood, tolerance, voxel, through_query=False)
    facing = (planes.normals * to_camera).sum(axis=1)
    solid = replace(grid, points_xyz=points)
    bulge = height_over_planes(solid, classified.max_edge, place, planes)
    height = planes.height - np.copysign(1.0, facing) * bulge
    with np.errstate(divide='ignore', invalid='ignore'):
        along = np.nan_to_num(-height / facing)
    truncated, end = classified.truncated[place], classified.end[place]
    own = np.hypot(grid.sigma[place], np.where(end, _END_BIAS * sigma, 0.0))
    plane_sigma = np.maximum(planes.height_sigma, 1e-3) * sigma
    max_height = np.where(end, _MAX_END_HEIGHT * sigma, _MAX_UNCERTAIN_HEIGHT * grid.sigma[place])
    good = _is_reliable(planes, sigma, voxel) & (np.abs(facing) > _MIN_FACING)
    good &= _within_sheet(grid, place, along, sigma)
    good &= truncated | (np.abs(height) < max_height)
    # inverse-variance mean of point and plane; of a truncated end only its ray is known
    share = np.where(truncated, 1.0, own**2 / (own**2 + plane_sigma**2))
    chosen = tuple(index[good] for index in place)
    points[chosen] = (queries + (share * along)[:, None] * to_camera)[good]
    known = np.where(truncated, plane_sigma, np.sqrt(share) * plane_sigma)
    new_sigma = grid.sigma.copy()
    new_sigma[chosen] = np.maximum(known, _MIN_SIGMA * sigma)[good]
    return replace(grid, points_xyz=points, sigma=new_sigma)


def _is_reliable(planes: LocalPlanes, sigma: float, voxel: float) -> Bools:
    """Return (n,) bool, which planes have enough inliers that are spread widely enough."""
    far = np.abs(planes.height) > _FAR_HEIGHT * sigma
    return np.asarray(
        (planes.inlier_ratio > np.where(far, _MIN_INLIER_RATIO_FAR, _MIN_INLIER_RATIO))
        & (planes.inliers >= _MIN_INLIERS)
        & (planes.breadth > _MIN_BREADTH * voxel)
        & (planes.height_sigma < _MAX_HEIGHT_SIGMA)
    )


def _within_sheet(
    grid: RangeGrid, place: tuple[np.ndarray, ...], along: Floats, sigma: float
) -> Bools:
    """Return (n,) bool, which points stay in the light sheet when moved ``along`` their rays."""
    distance = np.abs(along)
    if grid.error_direction is not None:
        to_camera = np.broadcast_to(grid.to_camera, grid.points_xyz.shape)[place]
        error = np.broadcast_to(grid.error_direction, grid.points_xyz.shape)[place]
        distance = distance * np.linalg.norm(np.cross(to_camera, error), axis=1)
    sheet_sigma = grid.thickness or _SHEET_PER_POINT_SIGMA * sigma
    return np.asarray(distance < _SHEET_SIGMAS * sheet_sigma)
