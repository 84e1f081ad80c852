# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact position of the stripe, from the intersection of laser plane and triangles."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.shading import ShadingSetup
from ivfmc_ros.simulation.render.stripe_mask import lit_faces

_NEWTON_STEPS = 4
_DIFFERENCE_STEP = 0.01  # pixels, of the numerical derivative
_DEPTH_MATCH = 5e-6  # meters, between a point and the first intersection of its ray


@dataclass(frozen=True, eq=False, kw_only=True)
class StripeTruth:
    """
    Visible center of the stripe, in order of lines; a line may contain several points.

    A line is an image row (``rows`` stripes) or column (``columns`` stripes).

    line : (n,) int64
    across : (n,) float64, pixel coordinate along the line, exact to 0.0001 px
    uv : (n, 2) float64, the same as pixel (column, row)
    points_xyz : (n, 3) meters, ``turntable``
    on_part : (n,) bool, False on the platter
    """

    line: Ints
    across: Floats
    uv: Floats
    points_xyz: Floats
    on_part: Bools

    def __len__(self) -> int:
        return len(self.line)


def stripe_truth(setup: ShadingSetup, camera: Camera) -> StripeTruth:
    """Return the intersection of the laser plane with all surfaces visible to camera and laser."""
    along = 1 if setup.laser.stripe == 'rows' else 0
    face, start, stop = _sheet_intersections(setup)
    lines = camera.height if along else camera.width
    segment, line, across = _line_crossings(
        camera.project(start), camera.project(stop), along, lines
    )
    face = face[segment]
    uv = _on_sheet(setup, camera, face, _pixel(line, across, along), 1 - along)
    points = _seen_at(setup, camera, face, uv)
    keep = np.flatnonzero(
        (uv > -0.5).all(axis=1)
        & (uv < np.array(camera.size) - 0.5).all(axis=1)
        & _visible(setup, camera, face, uv, points)
    )
    keep = keep[np.lexsort((uv[keep, 1 - along], line[keep]))]
    return StripeTruth(
        line=line[keep],
        across=uv[keep, 1 - along],
        uv=uv[keep],
        points_xyz=transforms.apply(setup.part_from_camera, points[keep]),
        on_part=face[keep] < setup.scene.part_faces,
    )


def _sheet_intersections(setup: ShadingSetup) -> tuple[Ints, Floats, Floats]:
    """Return the faces that the laser plane intersects, and the (n, 3) ends of the segments."""
    scene = setup.scene
    vertices = transforms.apply(transforms.invert(setup.part_from_camera), scene.vertices_xyz)
    distance = setup.laser.distance(vertices)
    # a vertex exactly in the plane would belong to no side
    distance[distance == 0] = 1e-15
    face = lit_faces(scene, setup.part_from_camera, setup.source, distance, 0.0)
    ends = np.empty((len(face), 2, 3))
    used = np.zeros(len(face), dtype=np.int64)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        # the same arithmetic in both faces of an edge, so that the segments meet exactly
        a, b = np.sort(scene.faces[face][:, [i, j]], axis=1).T
        crossed = np.flatnonzero((distance[a] > 0) != (distance[b] > 0))
        a, b = a[crossed], b[crossed]
        part = (distance[a] / (distance[a] - distance[b]))[:, None]
        ends[crossed, used[crossed]] = vertices[a] + part * (vertices[b] - vertices[a])
        used[crossed] += 1
    return face, ends[:, 0], ends[:, 1]


def _line_crossings(
    start: Floats, stop: Floats, along: int, lines: int
) -> tuple[Ints, Ints, Floats]:
    """
    Return which segments cross which lines, and the approximate position.

    start, stop : (n, 2) pixels, ends of straight segments
    returns : (m,) segment, (m,) line, (m,) pixels along the line
    """
    first = np.ceil(np.minimum(start[:, along], stop[:, along])).clip(0, lines)
    after = np.ceil(np.maximum(start[:, along], stop[:, along])).clip(0, lines)
    counts = (after - first).astype(np.int64)
    segment = np.repeat(np.arange(len(start)), counts)
    within = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    line = first.astype(np.int64)[segment] + within
    a, b = start[segment], stop[segment]
    part = (line - a[:, along]) / (b[:, along] - a[:, along])
    return segment, line, a[:, 1 - along] + part * (b[:, 1 - along] - a[:, 1 - along])


def _pixel(line: Ints, across: Floats, along: int) -> Floats:
    return np.stack([across, line] if along else [line, across], axis=1).astype(np.float64)


def _on_sheet(setup: ShadingSetup, camera: Camera, face: Ints, uv: Floats, axis: int) -> Floats:
    """Return pixels moved along ``axis`` to the intersection of face and laser plane (Newton)."""
    uv = uv.copy()
    probe = np.eye(2)[axis] * _DIFFERENCE_STEP
    for _ in range(_NEWTON_STEPS):
        here = setup.laser.distance(_seen_at(setup, camera, face, uv))
        there = setup.laser.distance(_seen_at(setup, camera, face, uv + probe))
        with np.errstate(divide='ignore', invalid='ignore'):
            step = here * _DIFFERENCE_STEP / (there - here)
        uv[:, axis] -= np.nan_to_num(step, posinf=0.0, neginf=0.0).clip(-5, 5)
    return uv


def _seen_at(setup: ShadingSetup, camera: Camera, face: Ints, uv: Floats) -> Floats:
    """Return (n, 3) meters, camera_optical_frame: rays of pixels with the planes of faces."""
    rays = camera.rays(uv)
    turn, origin = setup.part_from_camera[:3, :3], setup.part_from_camera[:3, 3]
    return np.asarray(rays * setup.scene.plane_lengths(face, origin, rays @ turn.T)[:, None])


def _visible(setup: ShadingSetup, camera: Camera, face: Ints, uv: Floats, points: Floats) -> Bools:
    """Return (n,) bool: points (n, 3), camera_optical_frame, visible to camera and laser."""
    turn, origin = setup.part_from_camera[:3, :3], setup.part_from_camera[:3, 3]
    depth, _ = setup.scene.cast(origin, camera.rays(uv) @ turn.T)
    first = np.abs(depth - points[:, 2]) < _DEPTH_MATCH
    at = transforms.apply(setup.part_from_camera, points)
    return first & ~setup.scene.in_shadow(at, setup.scene.normals[face], setup.source)
