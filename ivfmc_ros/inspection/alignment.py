# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A measured surface laid onto its nominal one.

Globally by principal axes, then by the best fit of point to plane (Chen & Medioni 1992) of the
part of the points that has a counterpart; or by datum points (Kabsch 1976).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.surface import Surface
from ivfmc_ros.validation import require_one_of

METHODS = ('best_fit', 'global', 'none', 'datum')
_COARSE_POINTS, _FINE_POINTS = 1500, 20_000
_COARSE_ROUNDS, _FINE_ROUNDS = 12, 40
# Share of the points that the fit believes to have a counterpart.
_TRIM = 0.9
_TRIED = 4
_TWISTS = 12
# Principal extents nearer than this leave the turn about the third axis open.
_ROUND = 0.25
_SETTLED = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """
    nominal_from_mesh (4, 4), and how well the points used lie on the nominal afterwards.

    rms : metres; method : as asked for
    """

    nominal_from_mesh: Floats
    rms: float
    method: str


def align(points_xyz: Floats, nominal: Surface, vertices_xyz: Floats, method: str) -> Alignment:
    """
    Lay (n, 3) points onto a nominal surface.

    vertices_xyz : (m, 3) metres, of the nominal
    method : best_fit (from where it is), global (from anywhere) or none
    :raises ParameterError: unknown method
    :raises GeometryError: fewer than 6 points
    """
    require_one_of('align', method, ('best_fit', 'global', 'none'))
    if len(points_xyz) < 6:
        raise GeometryError(f'align: {len(points_xyz)} points do not fix a pose; 6 are needed')
    points = _thinned(points_xyz, _FINE_POINTS)
    T = np.eye(4)
    if method == 'global':
        T = _global_start(_thinned(points_xyz, _COARSE_POINTS), nominal, vertices_xyz)
    if method != 'none':
        T = _fit(points, nominal, T, _FINE_ROUNDS)
    return Alignment(nominal_from_mesh=T, rms=_cost(points, nominal, T), method=method)


def from_datums(measured_xyz: Floats, nominal_xyz: Floats) -> Alignment:
    """
    Lay measured datum points onto nominal ones, both (n, 3) metres, in the same order.

    :raises GeometryError: fewer than three points, or they lie on a line
    """
    if len(measured_xyz) != len(nominal_xyz) or len(measured_xyz) < 3:
        raise GeometryError('datum: three or more points are needed, as many nominal as measured')
    a, b = measured_xyz.mean(axis=0), nominal_xyz.mean(axis=0)
    u, sizes, vt = np.linalg.svd((measured_xyz - a).T @ (nominal_xyz - b))
    if sizes[1] < 1e-6 * sizes[0]:
        raise GeometryError('datum: the points lie on one line, which leaves a turn open')
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    R = vt.T @ flip @ u.T
    T = transforms.rigid(R, b - R @ a)
    left = transforms.apply(T, measured_xyz) - nominal_xyz
    return Alignment(
        nominal_from_mesh=T,
        rms=float(np.sqrt((left**2).sum(axis=1).mean())),
        method='datum',
    )


def _thinned(points: Floats, count: int) -> Floats:
    if len(points) <= count:
        return points
    chosen = np.random.default_rng(0).choice(len(points), count, replace=False)
    return np.asarray(points[np.sort(chosen)])


def _cost(points: Floats, nominal: Surface, T: Floats) -> float:
    distance = np.sort(nominal.nearest(transforms.apply(T, points)).distance)
    return float(np.sqrt(np.mean(distance[: max(6, int(_TRIM * len(distance)))] ** 2)))


def _fit(points: Floats, nominal: Surface, T: Floats, rounds: int) -> Floats:
    """Minimise the distance to the planes of the nearest faces, without the farthest tenth."""
    for _ in range(rounds):
        moved = transforms.apply(T, points)
        near = nominal.nearest(moved)
        used = near.distance <= np.quantile(near.distance, _TRIM)
        centre = moved[used].mean(axis=0)
        lever, n = moved[used] - centre, near.normals[used]
        gap = (n * (near.points_xyz[used] - moved[used])).sum(axis=1)
        A = np.concatenate([np.cross(lever, n), n], axis=1)
        # a direction that nothing holds (the turn of a round part) stays where it is
        step = np.linalg.lstsq(A, gap, rcond=1e-4)[0]
        R = _turn(step[:3])
        T = transforms.rigid(R, centre + step[3:] - R @ centre) @ T
        if np.abs(step).max() < _SETTLED:
            break
    return T


def _global_start(points: Floats, nominal: Surface, vertices: Floats) -> Floats:
    tried: list[tuple[float, int, Floats]] = []
    surface = _thinned(vertices, _COARSE_POINTS)
    for T in _poses(points, surface):
        tried.append((_cost(points[::5], nominal, T), len(tried), T))
    tried.sort(key=lambda item: item[:2])
    fitted = [_fit(points, nominal, T, _COARSE_ROUNDS) for *_, T in tried[: 3 * _TRIED]]
    return min(fitted, key=lambda T: _cost(points, nominal, T))


def _poses(points: Floats, surface: Floats) -> Iterator[Floats]:
    """Give poses that lay the principal axes of one on those of the other, either way round."""
    a, axes_a, _ = _principal(points)
    b, axes_b, sizes = _principal(surface)
    twists = [np.eye(3)]
    for axis in range(3):
        others = np.delete(sizes, axis)
        if others.min() > (1.0 - _ROUND) * others.max():
            turns = 2.0 * np.pi * np.arange(1, _TWISTS) / _TWISTS
            twists += [_turn(turn * np.eye(3)[axis]) for turn in turns]
    for signs, twist in product(product((1.0, -1.0), repeat=2), twists):
        flip = np.diag([*signs, signs[0] * signs[1]])
        R = axes_b @ twist @ flip @ axes_a.T
        yield transforms.rigid(R, b - R @ a)


def _principal(points: Floats) -> tuple[Floats, Floats, Floats]:
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    _, sizes, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    axes = axes.T
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return middle, axes, sizes


def _turn(vector: Floats) -> Floats:
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
