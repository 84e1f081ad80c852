# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Height of a curved surface over the plane through some of its points.

A plane through points of a convex surface lies inside of it, in their middle by half of their
variance times the curvature: 0.02 mm for points within 0.5 mm (1 sigma, both ways) on a sphere of
11 mm radius.
"""

import numpy as np

from ivfmc_ros.meshing.samples.grid_normals import grid_normals
from ivfmc_ros.meshing.samples.planes import LocalPlanes
from ivfmc_ros.meshing.samples.range_grid import connected_to_next
from ivfmc_ros.meshing.samples.range_grid import RangeGrid
from ivfmc_ros.meshing.samples.row_curvature import row_curvature
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


def height_over_planes(
    grid: RangeGrid, max_edge: float | None, place: tuple[Ints, ...], planes: LocalPlanes
) -> Floats:
    """
    Return the height of the surface over planes at their query points, (n,) meters.

    It is positive on the side of the camera, and 0 where the curvature is not known.

    grid : with ``thickness``; without it nothing is known
    place : (n,) rows and columns of the query points
    planes : through points around the query points
    """
    if not grid.thickness:
        return np.zeros(len(place[0]))
    points = grid.points_xyz
    down, right = (connected_to_next(grid, axis, max_edge) for axis in (0, 1))
    normals = grid_normals(points, grid.to_camera, down, right)
    along_rows = row_curvature(points, normals, right, down, grid.thickness).value[place]
    turned = np.swapaxes(points, 0, 1), np.swapaxes(normals, 0, 1)
    along_columns = row_curvature(*turned, down.T, right.T, grid.thickness).value.T[place]
    # principal directions are not searched: columns are taken to be perpendicular to rows
    row = np.roll(points, -1, axis=1)[place] - np.roll(points, 1, axis=1)[place]
    row = np.nan_to_num(row - _dot(row, planes.normals)[:, None] * planes.normals)
    row /= np.maximum(np.linalg.norm(row, axis=1, keepdims=True), 1e-12)
    column = np.cross(planes.normals, row)
    height = np.zeros(len(row))
    for curvature, direction in ((along_rows, row), (along_columns, column)):
        spread = np.einsum('ni,nij,nj->n', direction, planes.scatter, direction)
        away = _dot(direction, planes.centroid)
        height += 0.5 * curvature * (spread - away**2)
    return height


def _dot(first: Floats, second: Floats) -> Floats:
    return np.asarray((first * second).sum(axis=1))
