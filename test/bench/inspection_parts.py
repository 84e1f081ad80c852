# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the bench of the inspection, and the same with one feature off."""

from collections.abc import Callable
from collections.abc import Sequence

import numpy as np
from support.real_scan import data_folder
import trimesh

from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import polyline
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.parts.solids import stepped_shaft

# Diameters of holes and pins, and widths of grooves, meters.
DIAMETERS = (0.004, 0.006, 0.009, 0.014, 0.030)
WIDTHS = (0.003, 0.006, 0.012)
# Centers of the holes and pins on a plate, meters.
_CENTERS = ((-0.030, 0.030), (-0.031, 0.012), (-0.029, -0.008), (-0.025, -0.030), (0.016, 0.008))
_SIDE = 0.078  # of the plate
_PLATE, _PIN = 0.012, 0.012  # heights of the plate and of the pins
# Radii of a shaft with grooves, at their ground and between them; and width of its lands.
_GROUND, _LAND, _LAND_WIDTH = 0.021, 0.025, 0.009


def riser() -> Solid:
    """Return the idler riser of the shared data, centered on the platter."""
    mesh = trimesh.load(data_folder() / 'parts' / 'idler_riser.STL')
    mesh.merge_vertices(digits_vertex=5)
    low, high = mesh.bounds
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    return Solid(
        vertices_xyz=(np.asarray(mesh.vertices) - middle) / UNITS['inch'],
        faces=np.asarray(mesh.faces, dtype=np.int64),
    )


PARTS: dict[str, Callable[[], Solid]] = {
    'demo part': demo_part,
    'shaft': lambda: stepped_shaft([(0.03, 0.02), (0.02, 0.02), (0.012, 0.02)]),
    'riser': riser,
    'block': lambda: box((0.04, 0.04, 0.04)),
}


def plate_with_holes(diameters: Sequence[float] = DIAMETERS) -> Solid:
    """Return a plate with upright through holes."""
    half = _SIDE / 2
    outer = polyline((-half, -half), (half, -half), (half, half), (-half, half), (-half, -half))
    holes = [circle(d / 2, c)[::-1] for d, c in zip(diameters, _CENTERS, strict=True)]
    return stack([Layer(low=0.0, high=_PLATE, bottom=[outer, *holes])])


def plate_with_pins(diameters: Sequence[float] = DIAMETERS) -> Solid:
    """Return a plate with upright pins."""
    half = _SIDE / 2
    outer = polyline((-half, -half), (half, -half), (half, half), (-half, half), (-half, -half))
    pins = [circle(d / 2, c) for d, c in zip(diameters, _CENTERS, strict=True)]
    return stack(
        [
            Layer(low=0.0, high=_PLATE, bottom=[outer]),
            Layer(low=_PLATE, high=_PLATE + _PIN, bottom=pins),
        ]
    )


def shaft_with_grooves(widths: Sequence[float] = WIDTHS) -> Solid:
    """Return a shaft with grooves around it."""
    steps = [(_LAND, _LAND_WIDTH)]
    for width in widths:
        steps += [(_GROUND, width), (_LAND, _LAND_WIDTH)]
    return stepped_shaft(steps)


def groove_height(width: float) -> float:
    """Return the height of the middle of a groove of ``shaft_with_grooves``, meters."""
    before = WIDTHS.index(width)
    return (before + 1) * _LAND_WIDTH + sum(WIDTHS[:before]) + 0.5 * width


def perpendicular_planes(part: Solid, without: str, names: Sequence[str]) -> list[str]:
    """Return up to three of the named planes that are perpendicular to each other."""
    chosen: list[str] = []
    axes: list[np.ndarray] = []
    for region in segment_surface(part.vertices_xyz, part.faces):
        if region.shape is None or region.name == without or region.name not in names:
            continue
        if all(abs(region.shape.axis @ axis) < 0.1 for axis in axes):
            chosen.append(region.name)
            axes.append(region.shape.axis)
    return chosen[:3]


def with_feature_off(part: Solid, feature: str, step: float) -> Solid:
    """
    Return a part with one region moved outward.

    feature : name of the region, a plane or a cylinder; step : meters, of the diameter of a
        cylinder, or of a plane along its normal
    """
    region = next(r for r in segment_surface(part.vertices_xyz, part.faces) if r.name == feature)
    shape = region.shape
    if shape is None:
        raise ValueError(f'{feature}: has no shape')
    chosen = np.unique(part.faces[region.faces])
    vertices = part.vertices_xyz.copy()
    if shape.kind == 'plane':
        outward = np.nanmean(part.normals[region.faces], axis=0)
        vertices[chosen] += step * outward / np.linalg.norm(outward)
    else:
        radial = vertices[chosen] - shape.center_xyz
        radial -= (radial @ shape.axis)[:, None] * shape.axis
        radial /= np.linalg.norm(radial, axis=1, keepdims=True)
        vertices[chosen] += 0.5 * step * radial
    return Solid(vertices_xyz=vertices, faces=part.faces)
