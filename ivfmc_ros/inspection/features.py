# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Plane, cylinder, sphere and circle through points: size, place, form error (least squares).

A feature is fitted in the frame of its points' own middle, so that its figures do not lose digits
when the part stands far from the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

KINDS = ('plane', 'cylinder', 'sphere', 'circle')
_LEAST = {'plane': 3, 'cylinder': 6, 'sphere': 4, 'circle': 3}
# A direction in which points extend less than this, as a share of their extent, is none.
_FLAT = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Feature:
    """
    A shape through points. Lengths are metres.

    center_xyz : (3,) of the sphere or circle; the point of plane or axis nearest to the points
    axis : (3,) unit normal of plane or circle, or direction of a cylinder; NaN for a sphere
    diameter : NaN for a plane
    form : the farthest point on one side to the farthest on the other (ISO 1101)
    rms : of the points about the shape; count : of points
    """

    kind: str
    center_xyz: Floats
    axis: Floats
    diameter: float
    form: float
    rms: float
    count: int


def fit(kind: str, points_xyz: Floats) -> Feature:
    """
    Fit a shape to (n, 3) points.

    :raises ParameterError: unknown kind
    :raises GeometryError: the points are too few, or do not determine the shape
    """
    require_one_of('feature', kind, KINDS)
    if len(points_xyz) < _LEAST[kind] or not np.isfinite(points_xyz).all():
        raise GeometryError(
            f'feature: a {kind} needs {_LEAST[kind]} finite points, there are {len(points_xyz)}'
        )
    center = points_xyz.mean(axis=0)
    scale = float(np.sqrt(((points_xyz - center) ** 2).sum(axis=1).mean()))
    if not scale > 0:
        raise GeometryError(f'feature: all points of the {kind} are at one place')
    return _FITS[kind](points_xyz, center, scale)


def _made(
    kind: str, left: Floats, center: Floats, axis: Floats | None, diameter: float
) -> Feature:
    return Feature(
        kind=kind,
        center_xyz=center,
        axis=np.full(3, np.nan) if axis is None else axis,
        diameter=diameter,
        form=float(np.ptp(left)),
        rms=float(np.sqrt(np.mean(left**2))),
        count=len(left),
    )


def _plane(points: Floats, center: Floats, scale: float) -> Feature:
    _, sizes, axes = np.linalg.svd((points - center) / scale, full_matrices=False)
    if sizes[1] < _FLAT * sizes[0]:
        raise GeometryError('feature: the points of the plane lie on one line')
    return _made('plane', (points - center) @ axes[2], center, axes[2], float('nan'))


def _sphere(points: Floats, center: Floats, scale: float) -> Feature:
    at = (points - center) / scale
    if np.linalg.svd(at, compute_uv=False)[2] < _FLAT * np.sqrt(len(at)):
        raise GeometryError('feature: the points of the sphere lie in one plane')
    start = _algebraic(at)
    found = least_squares(lambda p: np.linalg.norm(at - p[:3], axis=1) - p[3], start)
    middle, radius = found.x[:3] * scale + center, float(found.x[3]) * scale
    return _made('sphere', found.fun * scale, middle, None, 2.0 * radius)


def _algebraic(at: Floats) -> Floats:
    """Return the center and radius of a circle or sphere, from |x|^2 = 2 c.x + (r^2 - c^2)."""
    A = np.column_stack([2.0 * at, np.ones(len(at))])
    solved = np.linalg.lstsq(A, (at**2).sum(axis=1), rcond=None)[0]
    center = solved[:-1]
    return np.append(center, np.sqrt(max(solved[-1] + center @ center, 1e-12)))


def _circle(points: Floats, center: Floats, scale: float) -> Feature:
    plane = _plane(points, center, scale)
    flat = _across(plane.axis)
    at = (points - center) @ flat / scale
    found = least_squares(lambda p: np.linalg.norm(at - p[:2], axis=1) - p[2], _algebraic(at))
    middle = center + flat @ found.x[:2] * scale
    return _made('circle', found.fun * scale, middle, plane.axis, 2.0 * float(found.x[2]) * scale)


def _across(axis: Floats) -> Floats:
    """Return (3, 2): two unit vectors square to an axis and to each other."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)


def _cylinder(points: Floats, center: Floats, scale: float) -> Feature:
    at = (points - center) / scale
    rough = [_fit_cylinder(at[:: max(1, len(at) // 300)], axis, 12) for axis in _starts(at)]
    start = min(rough, key=lambda tried: tried[2])[0]
    axis, middle, _, left, radius = _fit_cylinder(at, start, 60)
    if radius > _LARGEST:
        raise GeometryError('feature: the points of the cylinder are as good as flat')
    return _made('cylinder', left * scale, middle * scale + center, axis, 2.0 * radius * scale)


# In extents of its points: of a flatter arc, noise makes any diameter.
_LARGEST = 100.0


def _starts(at: Floats) -> Floats:
    return np.concatenate([np.linalg.svd(at, full_matrices=False)[2], np.eye(3)])


def _fit_cylinder(
    at: Floats, axis: Floats, most: int
) -> tuple[Floats, Floats, float, Floats, float]:
    flat = _across(axis)

    def parts(p: Floats) -> tuple[Floats, Floats, Floats]:
        direction = axis + flat @ p[:2]
        direction = direction / np.linalg.norm(direction)
        middle = flat @ p[2:4]
        offset = at - middle
        offset = offset - (offset @ direction)[:, None] * direction
        return direction, middle, np.linalg.norm(offset, axis=1)

    start = _algebraic(at @ flat)
    found = least_squares(
        lambda p: parts(p)[2] - p[4], np.concatenate([np.zeros(2), start]), max_nfev=most
    )
    direction, middle, distance = parts(found.x)
    middle = middle + ((at.mean(axis=0) - middle) @ direction) * direction
    radius = abs(float(found.x[4]))
    return direction, middle, float(found.cost), distance - radius, radius


_FITS: dict[str, Callable[[Floats, Floats, float], Feature]] = {
    'plane': _plane,
    'cylinder': _cylinder,
    'sphere': _sphere,
    'circle': _circle,
}
