# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated solids: a machined demo part, and simple shapes for tests."""

from collections.abc import Sequence
import math

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.prism import arc
from ivfmc_ros.simulation.parts.prism import CHORD
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import circle_segments
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import polyline
from ivfmc_ros.simulation.parts.prism import stack

# Dimensions of the demo part in meters, azimuth in radians.
FLANGE_RADIUS, FLANGE_TOP, CHAMFER = 0.052, 0.012, 0.0015
HUB_RADIUS, HUB_TOP = 0.028, 0.050
SHAFT_RADIUS, SHAFT_TOP = 0.015, 0.085
BOLTS, BOLT_CIRCLE, BOLT_RADIUS = 6, 0.040, 0.0045
FLAT_DISTANCE, FLAT_FLOOR = 0.022, 0.026
KEYWAY_WIDTH, KEYWAY_BOTTOM, KEYWAY_FLOOR, KEYWAY_AZIMUTH = 0.008, 0.011, 0.058, 2.0
HOLE_RADIUS, HOLE_FLOOR = 0.007, 0.065


def demo_part() -> Solid:
    """
    Return a machined part that stands on the platter, coaxial with the table.

    A chamfered flange with six bolt holes, a hub with a milled flat that faces +x, a shaft end
    with an open keyway and a blind hole. It has no rotational symmetry and fits into the working
    volume of the bench cell. Arcs are accurate to 1 um.
    """
    bolts = [circle(BOLT_RADIUS, center)[::-1] for center in _bolt_centers()]
    flange, rim = circle(FLANGE_RADIUS), _with_radius_offset(circle(FLANGE_RADIUS), -CHAMFER)
    hub, flat_hub = _hub()
    shaft, keyed = _shaft()
    hole = circle(HOLE_RADIUS)[::-1]
    chamfer_floor = FLANGE_TOP - CHAMFER
    return stack(
        [
            Layer(low=0.0, high=chamfer_floor, bottom=[flange, *bolts]),
            Layer(low=chamfer_floor, high=FLANGE_TOP, bottom=[flange, *bolts], top=[rim, *bolts]),
            Layer(low=FLANGE_TOP, high=FLAT_FLOOR, bottom=[hub]),
            Layer(low=FLAT_FLOOR, high=HUB_TOP, bottom=[flat_hub]),
            Layer(low=HUB_TOP, high=KEYWAY_FLOOR, bottom=[shaft]),
            Layer(low=KEYWAY_FLOOR, high=HOLE_FLOOR, bottom=[keyed]),
            Layer(low=HOLE_FLOOR, high=SHAFT_TOP, bottom=[keyed, hole]),
        ]
    )


def cylinder(radius: float, height: float) -> Solid:
    """Return a cylinder around the table axis, radius and height in meters."""
    return stack([Layer(low=0.0, high=height, bottom=[circle(radius)])])


def stepped_shaft(steps: Sequence[tuple[float, float]]) -> Solid:
    """
    Return coaxial cylinders on top of each other around the table axis.

    steps : (radius, height) of each in meters, from the platter up
    """
    tops = np.cumsum([height for _, height in steps])
    lows = [0.0, *tops[:-1].tolist()]
    return stack(
        [
            Layer(low=low, high=float(high), bottom=[circle(radius)])
            for (radius, _), low, high in zip(steps, lows, tops, strict=True)
        ]
    )


def box(size_xyz: Sequence[float]) -> Solid:
    """Return a box that stands on the platter, centered on the axis; sides in meters."""
    x, y, z = np.asarray(size_xyz) / 2
    corners = np.array([[i, j, k] for k in (0.0, 2 * z) for j in (-y, y) for i in (-x, x)])
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [[quad[0], *quad[i : i + 2]] for quad in quads for i in (1, 2)]
    return Solid(vertices_xyz=corners, faces=np.array(faces))


def plate(width: float, height: float, thickness: float) -> Solid:
    """Return an upright plate that faces +x; width, height and thickness in meters."""
    return box((thickness, width, height))


def sphere(radius: float, center_height: float | None = None) -> Solid:
    """
    Return a sphere on the table axis.

    radius : meters
    center_height : meters above the platter; by default the sphere touches it
    """
    height = radius if center_height is None else center_height
    # curved in two directions, each with half of the chord error
    around = circle_segments(radius, CHORD / 2)
    rings = around // 2
    polar = np.pi * np.arange(1, rings) / rings
    azimuth = 2 * np.pi * np.arange(around) / around
    ring_points = np.stack(
        [
            np.outer(np.sin(polar), np.cos(azimuth)),
            np.outer(np.sin(polar), np.sin(azimuth)),
            np.repeat(np.cos(polar)[:, None], around, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    unit = np.concatenate([ring_points, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    vertices = unit * radius + (0.0, 0.0, height)
    return Solid(vertices_xyz=vertices, faces=_sphere_faces(rings - 1, around))


def _sphere_faces(rings: int, around: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the faces between rings from the upper pole (second last vertex) to the lower."""
    index = np.arange(rings * around).reshape(rings, around)
    following = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], following[:-1], following[1:], index[1:]
    north = np.full(around, rings * around)
    faces = [
        np.stack([north, index[0], following[0]], axis=-1),
        np.stack([a, d, c], axis=-1).reshape(-1, 3),
        np.stack([a, c, b], axis=-1).reshape(-1, 3),
        np.stack([north + 1, following[-1], index[-1]], axis=-1),
    ]
    return np.concatenate(faces).astype(np.int64)


def _bolt_centers() -> list[list[float]]:
    angles = 2 * np.pi * (np.arange(BOLTS) + 0.5) / BOLTS
    centers: list[list[float]] = (
        BOLT_CIRCLE * np.stack([np.cos(angles), np.sin(angles)], 1)
    ).tolist()
    return centers


def _with_radius_offset(outline: Floats, offset: float) -> Floats:
    """Return a circle about the origin with its radius changed by ``offset``."""
    radius = float(np.linalg.norm(outline[0]))
    return np.asarray(outline * (radius + offset) / radius)


def _hub() -> tuple[Floats, Floats]:
    """Return the hub's outlines below and at the flat; both share the points of the round side."""
    half = math.acos(FLAT_DISTANCE / HUB_RADIUS)
    round_side = arc(HUB_RADIUS, half, 2 * math.pi - half)
    cut_away = arc(HUB_RADIUS, -half, half)
    chord = HUB_RADIUS * math.sin(half)
    flat = polyline((FLAT_DISTANCE, -chord), (FLAT_DISTANCE, chord))
    return np.concatenate([round_side, cut_away]), np.concatenate([round_side, flat])


def _shaft() -> tuple[Floats, Floats]:
    """Return the shaft's outlines below and at the keyway; both share the round side."""
    half = math.asin(KEYWAY_WIDTH / 2 / SHAFT_RADIUS)
    round_side = arc(SHAFT_RADIUS, half, 2 * math.pi - half)
    mouth, wall = SHAFT_RADIUS * math.cos(half), KEYWAY_WIDTH / 2
    slot = polyline((mouth, -wall), (KEYWAY_BOTTOM, -wall), (KEYWAY_BOTTOM, wall), (mouth, wall))
    cut_away = arc(SHAFT_RADIUS, -half, half)
    return _rotated(np.concatenate([round_side, cut_away])), _rotated(
        np.concatenate([round_side, slot])
    )


def _rotated(outline: Floats) -> Floats:
    cos, sin = math.cos(KEYWAY_AZIMUTH), math.sin(KEYWAY_AZIMUTH)
    return np.asarray(outline @ np.array([[cos, sin], [-sin, cos]]))
