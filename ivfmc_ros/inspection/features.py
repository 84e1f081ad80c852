# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Least-squares fit of plane, cylinder, sphere and circle to points: pose, size and form error.

Points are centered and scaled before the fit, against loss of precision far from the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

KINDS = ('plane', 'cylinder', 'sphere', 'circle')
# Minimum number of points: degrees of freedom of the shape.
_MIN_POINTS = {'plane': 3, 'cylinder': 6, 'sphere': 4, 'circle': 3}
# Relative singular value below which the points are degenerate in a direction.
_DEGENERATE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Feature:
    """
    A fitted shape. Lengths are meters.

    kind : one of ``KINDS``
    center_xyz : (3,) center of sphere or circle; for plane and cylinder, the point of plane or
        axis nearest to the centroid of the points
    axis : (3,) unit normal of plane or circle, or direction of a cylinder; NaN for a sphere
    diameter : NaN for a plane
    form : peak-to-valley deviation of the points from the shape (form error, ISO 1101)
    rms : rms deviation of the points from the shape; count : number of points
    """

    kind: str
    center_xyz: Floats
    axis: Floats
    diameter: float
    form: float
    rms: float
    count: int


def fit(
    kind: str, points_xyz: Floats, axis: Floats | None = None, *, fixed: bool = False
) -> Feature:
    """
    Fit a shape to points by least squares.

    kind : one of ``KINDS``
    points_xyz : (n, 3) meters
    axis : (3,) unit, approximate direction of a cylinder, where the fit starts; None: searched
    fixed : the cylinder has exactly the direction ``axis``
    :raises ParameterError: unknown kind
    :raises GeometryError: too few points, or they do not determine the shape
    """
    require_one_of('feature', kind, KINDS)
    if len(points_xyz) < _MIN_POINTS[kind] or not np.isfinite(points_xyz).all():
        raise GeometryError(
            f'feature: a {kind} needs at least {_MIN_POINTS[kind]} finite points, '
            f'there are {len(points_xyz)}'
        )
    center = points_xyz.mean(axis=0)
    scale = float(np.sqrt(((points_xyz - center) ** 2).sum(axis=1).mean()))
    if not scale > 0:
        raise GeometryError(f'feature: all points of the {kind} coincide')
    if kind == 'cylinder':
        return _cylinder(points_xyz, center, scale, axis, fixed=fixed)
    return _FITS[kind](points_xyz, center, scale)


def residuals(shape: Feature, points_xyz: Floats) -> Floats:
    """
    Return the signed distances of points (n, 3) from a shape, (n,) meters.

    Positive is outside of a cylinder or sphere, and along the normal of a plane.
    """
    offset = points_xyz - shape.center_xyz
    if shape.kind == 'plane':
        return np.asarray(offset @ shape.axis)
    if shape.kind in {'cylinder', 'circle'}:
        offset = offset - (offset @ shape.axis)[:, None] * shape.axis
    return np.asarray(np.linalg.norm(offset, axis=1) - 0.5 * shape.diameter)


def _feature(
    kind: str, residuals: Floats, center: Floats, axis: Floats | None, diameter: float
) -> Feature:
    return Feature(
        kind=kind,
        center_xyz=center,
        axis=np.full(3, np.nan) if axis is None else axis,
        diameter=diameter,
        form=float(np.ptp(residuals)),
        rms=float(np.sqrt(np.mean(residuals**2))),
        count=len(residuals),
    )


def _plane(points: Floats, center: Floats, scale: float) -> Feature:
    _, sizes, axes = np.linalg.svd((points - center) / scale, full_matrices=False)
    if sizes[1] < _DEGENERATE * sizes[0]:
        raise GeometryError('feature: the points of the plane are collinear')
    # the sign does not vary between fits to nearly equal points
    axis = axes[2] * np.copysign(1.0, axes[2][np.abs(axes[2]).argmax()])
    return _feature('plane', (points - center) @ axis, center, axis, float('nan'))


def _sphere(points: Floats, center: Floats, scale: float) -> Feature:
    scaled = (points - center) / scale
    if np.linalg.svd(scaled, compute_uv=False)[2] < _DEGENERATE * np.sqrt(len(scaled)):
        raise GeometryError('feature: the points of the sphere are coplanar')
    start = _algebraic(scaled)
    found = least_squares(lambda p: np.linalg.norm(scaled - p[:3], axis=1) - p[3], start)
    middle, radius = found.x[:3] * scale + center, float(found.x[3]) * scale
    return _feature('sphere', found.fun * scale, middle, None, 2.0 * radius)


def _algebraic(scaled: Floats) -> Floats:
    """Return center and radius by the algebraic fit |x|^2 = 2 c.x + (r^2 - c^2) (Kasa 1976)."""
    A = np.column_stack([2.0 * scaled, np.ones(len(scaled))])
    solved = np.linalg.lstsq(A, (scaled**2).sum(axis=1), rcond=None)[0]
    center = solved[:-1]
    return np.append(center, np.sqrt(max(solved[-1] + center @ center, 1e-12)))


def _circle(points: Floats, center: Floats, scale: float) -> Feature:
    plane = _plane(points, center, scale)
    basis = _perpendicular(plane.axis)
    scaled = (points - center) @ basis / scale
    found = least_squares(
        lambda p: np.linalg.norm(scaled - p[:2], axis=1) - p[2], _algebraic(scaled)
    )
    middle = center + basis @ found.x[:2] * scale
    return _feature(
        'circle', found.fun * scale, middle, plane.axis, 2.0 * float(found.x[2]) * scale
    )


def _perpendicular(axis: Floats) -> Floats:
    """Return (3, 2): two unit vectors perpendicular to an axis and to each other."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)


def _cylinder(
    points: Floats, center: Floats, scale: float, start: Floats | None, *, fixed: bool
) -> Feature:
    scaled = (points - center) / scale
    if start is None:
        few = scaled[:: max(1, len(scaled) // 300)]
        rough = [_fit_cylinder(few, axis, 12) for axis in _initial_axes(scaled)]
        start = min(rough, key=lambda tried: tried[2])[0]
    fitted = _fit_circle_about(scaled, start) if fixed else _fit_cylinder(scaled, start, 60)
    axis, middle, _, residuals, radius = fitted
    if radius > _MAX_RADIUS:
        raise GeometryError('feature: the points of the cylinder are almost coplanar')
    return _feature(
        'cylinder', residuals * scale, middle * scale + center, axis, 2.0 * radius * scale
    )


def _fit_circle_about(scaled: Floats, axis: Floats) -> tuple[Floats, Floats, float, Floats, float]:
    """Fit a cylinder of a given direction: a circle in the plane perpendicular to it."""
    basis = _perpendicular(axis)
    flat = scaled @ basis
    found = least_squares(
        lambda p: np.linalg.norm(flat - p[:2], axis=1) - p[2], _algebraic(flat), method='lm'
    )
    middle = basis @ found.x[:2] + (scaled.mean(axis=0) @ axis) * axis
    return axis, middle, float(found.cost), found.fun, float(found.x[2])


# Largest radius of a cylinder in rms extents of its points; a flatter arc does not determine it.
_MAX_RADIUS = 100.0


def _initial_axes(scaled: Floats) -> Floats:
    return np.concatenate([np.linalg.svd(scaled, full_matrices=False)[2], np.eye(3)])


def _fit_cylinder(
    scaled: Floats, axis: Floats, max_evaluations: int
) -> tuple[Floats, Floats, float, Floats, float]:
    basis = _perpendicular(axis)

    def parts(p: Floats) -> tuple[Floats, Floats, Floats]:
        direction = axis + basis @ p[:2]
        direction = direction / np.linalg.norm(direction)
        middle = basis @ p[2:4]
        offset = scaled - middle
        offset = offset - (offset @ direction)[:, None] * direction
        return direction, middle, np.linalg.norm(offset, axis=1)

    start = _algebraic(scaled @ basis)
    found = least_squares(
        lambda p: parts(p)[2] - p[4],
        np.concatenate([np.zeros(2), start]),
        max_nfev=max_evaluations,
    )
    direction, middle, distance = parts(found.x)
    middle = middle + ((scaled.mean(axis=0) - middle) @ direction) * direction
    radius = abs(float(found.x[4]))
    return direction, middle, float(found.cost), distance - radius, radius


_FITS: dict[str, Callable[[Floats, Floats, float], Feature]] = {
    'plane': _plane,
    'sphere': _sphere,
    'circle': _circle,
}
