# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the stripe truly is, computed from the triangles and not from a picture."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.simulation.render.band import lit_faces
from ivfmc_ros.simulation.render.shade import Stage

_NEWTON_STEPS = 4
_PROBE = 0.01  # pixels
_DEPTH_MATCH = 5e-6  # metres


@dataclass(frozen=True, eq=False, kw_only=True)
class StripeTruth:
    """
    Where the middle of the sheet is seen, in order of lines; a line may have several places.

    A line is an image row (``rows`` stripes) or column (``columns`` stripes).

    line : (n,) int64
    across : (n,) float64, pixels along the line, exact to 0.0001 px
    uv : (n, 2) float64, the same as pixel (column, row)
    points_xyz : (n, 3) metres, ``turntable``
    on_part : (n,) bool, False on the platter
    """

    line: Ints
    across: Floats
    uv: Floats
    points_xyz: Floats
    on_part: Bools

    def __len__(self) -> int:
        return len(self.line)


def stripe_truth(stage: Stage, camera: Camera) -> StripeTruth:
    """Return the crossings of the sheet with what camera and laser both see."""
    along = 1 if stage.laser.stripe == 'rows' else 0
    face, start, stop = _cuts(stage)
    lines = camera.height if along else camera.width
    piece, line, across = _crossings(camera.project(start), camera.project(stop), along, lines)
    face = face[piece]
    uv = _on_sheet(stage, camera, face, _pixel(line, across, along), 1 - along)
    points = _seen_at(stage, camera, face, uv)
    keep = np.flatnonzero(
        (uv > -0.5).all(axis=1)
        & (uv < np.array(camera.size) - 0.5).all(axis=1)
        & _visible(stage, camera, face, uv, points)
    )
    keep = keep[np.lexsort((uv[keep, 1 - along], line[keep]))]
    return StripeTruth(
        line=line[keep],
        across=uv[keep, 1 - along],
        uv=uv[keep],
        points_xyz=transforms.apply(stage.part_from_camera, points[keep]),
        on_part=face[keep] < stage.scene.part_faces,
    )


def _cuts(stage: Stage) -> tuple[Ints, Floats, Floats]:
    """Return the faces that the sheet cuts, and the ends of the cuts in the camera's frame."""
    scene = stage.scene
    vertices = transforms.apply(transforms.invert(stage.part_from_camera), scene.vertices_xyz)
    distance = stage.laser.distance(vertices)
    # a corner that is exactly in the sheet would belong to no side
    distance[distance == 0] = 1e-15
    face = lit_faces(scene, stage.part_from_camera, stage.source, distance, 0.0)
    ends = np.empty((len(face), 2, 3))
    used = np.zeros(len(face), dtype=np.int64)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        # the same arithmetic in both faces of an edge, so that the cuts meet exactly
        a, b = np.sort(scene.faces[face][:, [i, j]], axis=1).T
        crossed = np.flatnonzero((distance[a] > 0) != (distance[b] > 0))
        a, b = a[crossed], b[crossed]
        part = (distance[a] / (distance[a] - distance[b]))[:, None]
        ends[crossed, used[crossed]] = vertices[a] + part * (vertices[b] - vertices[a])
        used[crossed] += 1
    return face, ends[:, 0], ends[:, 1]


def _crossings(start: Floats, stop: Floats, along: int, lines: int) -> tuple[Ints, Ints, Floats]:
    """
    Return which pieces cross which lines, and about where.

    start, stop : (n, 2) pixels, ends of straight pieces
    returns : (m,) piece, (m,) line, (m,) pixels along the line
    """
    first = np.ceil(np.minimum(start[:, along], stop[:, along])).clip(0, lines)
    after = np.ceil(np.maximum(start[:, along], stop[:, along])).clip(0, lines)
    counts = (after - first).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), counts)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    line = first.astype(np.int64)[piece] + within
    a, b = start[piece], stop[piece]
    part = (line - a[:, along]) / (b[:, along] - a[:, along])
    return piece, line, a[:, 1 - along] + part * (b[:, 1 - along] - a[:, 1 - along])


def _pixel(line: Ints, across: Floats, along: int) -> Floats:
    return np.stack([across, line] if along else [line, across], axis=1).astype(np.float64)


def _on_sheet(stage: Stage, camera: Camera, face: Ints, uv: Floats, axis: int) -> Floats:
    """Return pixels moved along ``axis`` to where they see face and sheet at once."""
    uv = uv.copy()
    probe = np.eye(2)[axis] * _PROBE
    for _ in range(_NEWTON_STEPS):
        here = stage.laser.distance(_seen_at(stage, camera, face, uv))
        there = stage.laser.distance(_seen_at(stage, camera, face, uv + probe))
        with np.errstate(divide='ignore', invalid='ignore'):
            step = here * _PROBE / (there - here)
        uv[:, axis] -= np.nan_to_num(step, posinf=0.0, neginf=0.0).clip(-5, 5)
    return uv


def _seen_at(stage: Stage, camera: Camera, face: Ints, uv: Floats) -> Floats:
    """Return where pixels see the planes of faces, (n, 3) metres, camera_optical_frame."""
    rays = camera.rays(uv)
    turn, origin = stage.part_from_camera[:3, :3], stage.part_from_camera[:3, 3]
    return np.asarray(rays * stage.scene.plane_lengths(face, origin, rays @ turn.T)[:, None])


def _visible(stage: Stage, camera: Camera, face: Ints, uv: Floats, points: Floats) -> Bools:
    """Tell which points (n, 3), camera_optical_frame, are first for the camera and not shaded."""
    turn, origin = stage.part_from_camera[:3, :3], stage.part_from_camera[:3, 3]
    depth, _ = stage.scene.cast(origin, camera.rays(uv) @ turn.T)
    first = np.abs(depth - points[:, 2]) < _DEPTH_MATCH
    at = transforms.apply(stage.part_from_camera, points)
    return first & ~stage.scene.shaded(at, stage.scene.normals[face], stage.source)
