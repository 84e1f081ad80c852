# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Alignment of round holes along a motion that the other surface does not constrain.

Both scans see parts of the same hole walls. The amount of the motion is found by Gauss-Newton,
so that the visible parts of each hole lie on one common circle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.merge.holes import Hole

# Corresponding holes have parallel axes (least cosine) and radii that differ by less than this
# fraction.
_MIN_COSINE, _RADIUS_TOLERANCE = 0.998, 0.15
# Least displacement of a hole perpendicular to its axis, as a fraction of the motion, with which
# it constrains the motion.
_MIN_DISPLACEMENT = 0.2
# Fewer corresponding holes could be a coincidence.
_MIN_HOLES = 3
# Walls are one circle if their rms distance from it is below this many sigmas of a point; the
# width of the robust (Geman-McClure) weights, in sigmas.
_MAX_RMS_SIGMAS, _ROBUST_SIGMAS = 6.0, 2.5
_ITERATIONS = 12


@dataclass(frozen=True, kw_only=True)
class HoleFit:
    """
    Amount of a motion that aligns the holes.

    amount, sigma : meters of the motion, and its standard uncertainty
    holes : number of corresponding holes
    """

    amount: float
    sigma: float
    holes: int


def matching_poses(
    source: Sequence[Hole], target: Sequence[Hole], path: Floats, max_distance: float
) -> Ints:
    """
    Return the indices of poses that bring a hole onto another one, the best of each run.

    One hole is enough: where only few holes are visible, a pose at which few correspond may be
    the true one, and must be refuted before another one is accepted.

    path : (k, 4, 4) poses along a closed motion; the first follows the last
    max_distance : meters, between the axes of corresponding holes
    """
    similar = np.array([[_similar_radius(one, other) for other in target] for one in source])
    if not similar.size or not similar.any():
        return np.empty(0, dtype=np.int64)
    centers, axes = (
        np.array([getattr(hole, name) for hole in target]) for name in ('center', 'axis')
    )
    source_axes = np.array([hole.axis for hole in source])
    source_centers = np.array([hole.center for hole in source])
    moved = np.array([transforms.apply(T, source_centers) for T in path])
    cosines = np.abs(np.einsum('kij,bj,oi->kbo', path[:, :3, :3], source_axes, axes))
    offset = moved[:, :, None] - centers
    offset = offset - (offset * axes).sum(axis=-1, keepdims=True) * axes
    distance = np.linalg.norm(offset, axis=-1)
    distance = np.where(similar & (cosines > _MIN_COSINE), distance, np.inf).min(axis=2)
    score = np.maximum(1.0 - distance / max_distance, 0.0).sum(axis=1)
    matching = np.flatnonzero(score > 0.0)
    runs = np.split(matching, np.flatnonzero(np.diff(matching) > 1) + 1)
    if len(runs) > 1 and runs[0][0] == 0 and runs[-1][-1] == len(path) - 1:
        runs[0] = np.concatenate([runs.pop(), runs[0]])
    return np.array([run[np.argmax(score[run])] for run in runs if len(run)], dtype=np.int64)


def _similar_radius(one: Hole, other: Hole) -> bool:
    return abs(one.radius - other.radius) < _RADIUS_TOLERANCE * max(one.radius, other.radius)


def constraining_holes(holes: Sequence[Hole], motion: Floats) -> list[Hole]:
    """Return the holes that a (6,) motion of one meter displaces perpendicular to their axes."""
    found = []
    for hole in holes:
        velocity = _velocity(motion, hole.center[None])[0]
        across = velocity - hole.axis * (velocity @ hole.axis)
        if np.linalg.norm(across) > _MIN_DISPLACEMENT:
            found.append(hole)
    return found


def align_holes(
    source: Sequence[Hole], target: Sequence[Hole], motion: Floats, max_distance: float
) -> HoleFit | None:
    """
    Return the amount of a motion that aligns the holes; None if too few correspond.

    motion : (6,) rotation vector and translation, for an amount of one meter
    max_distance : meters, between the axes of corresponding holes at first
    """
    amount = 0.0
    for _ in range(_ITERATIONS):
        moved = [hole.transformed(motion_transform(motion, amount)) for hole in source]
        matches = _correspondences(moved, target, max_distance)
        if len(matches) < _MIN_HOLES:
            return None
        step = _common_circle_step(matches, motion)
        amount += step
        # a tenth of a micrometer
        if abs(step) < 1e-7:
            break
    moved = [hole.transformed(motion_transform(motion, amount)) for hole in source]
    matches = [
        match for match in _correspondences(moved, target, max_distance) if _on_one_circle(match)
    ]
    if len(matches) < _MIN_HOLES:
        return None
    step = _common_circle_step(matches, motion)
    # jackknife over the holes, because the errors of one wall are correlated
    without = [
        _common_circle_step(matches[:k] + matches[k + 1 :], motion) for k in range(len(matches))
    ]
    sigma = np.sqrt((len(matches) - 1) * np.var(without))
    return HoleFit(amount=amount + step, sigma=float(sigma), holes=len(matches))


def motion_transform(motion: Floats, amount: float) -> Floats:
    """Return the (4, 4) screw motion of ``amount`` times a (6,) rotation vector, translation."""
    rotation, translation = motion[:3], motion[3:]
    rate = float(np.linalg.norm(rotation))
    if rate * abs(amount) < 1e-12:
        return transforms.rigid(np.eye(3), amount * translation)
    R = Rotation.from_rotvec(amount * rotation).as_matrix()
    point = np.cross(rotation, translation) / rate**2
    along_axis = amount * rotation * float(rotation @ translation) / rate**2
    return transforms.rigid(R, point - R @ point + along_axis)


def _correspondences(
    source: Sequence[Hole], target: Sequence[Hole], max_distance: float
) -> list[tuple[Hole, Hole]]:
    """Return each source hole with the nearest target hole of its direction and radius."""
    matches = []
    for one in source:
        nearest, least = None, max_distance
        for other in target:
            offset = one.center - other.center
            distance = float(np.linalg.norm(offset - other.axis * (offset @ other.axis)))
            parallel = abs(one.axis @ other.axis) > _MIN_COSINE
            if parallel and _similar_radius(one, other) and distance < least:
                nearest, least = other, distance
        if nearest is not None:
            matches.append((one, nearest))
    return matches


def _common_circle_step(matches: Sequence[tuple[Hole, Hole]], motion: Floats) -> float:
    """Return the step of the amount that makes each pair of walls one circle, least squares."""
    weighted = total = 0.0
    for one, other in matches:
        information, product = _amount_information(one, other, motion)
        total, weighted = total + information, weighted + product
    return weighted / total


def _amount_information(one: Hole, other: Hole, motion: Floats) -> tuple[float, float]:
    """Return the information of a hole about the amount, and that times its estimate."""
    J, r, sigma = _circle_residuals(one, other, motion)
    weight = 1.0 / (sigma**2 * (1.0 + (r / (_ROBUST_SIGMAS * sigma)) ** 2) ** 2)
    N = (J * weight[:, None]).T @ J
    g = J.T @ (weight * r)
    # Schur complement that eliminates center and radius
    eliminated = np.linalg.solve(N[1:, 1:], np.column_stack([N[1:, 0], g[1:]]))
    return (
        float(N[0, 0] - N[0, 1:] @ eliminated[:, 0]),
        float(-(g[0] - N[0, 1:] @ eliminated[:, 1])),
    )


def _circle_residuals(one: Hole, other: Hole, motion: Floats) -> tuple[Floats, Floats, float]:
    """
    Fit one circle to two walls.

    returns : (n, 4) Jacobian by amount, center (2), radius; (n,) residuals; sigma in meters
    """
    plane = np.linalg.svd(other.axis[None])[2][1:].T
    moving, fixed = one.points_xyz @ plane, other.points_xyz @ plane
    velocity = _velocity(motion, one.points_xyz) @ plane
    q = np.concatenate([moving, fixed])
    velocity = np.concatenate([velocity, np.zeros_like(fixed)])
    center, radius = (one.center + other.center) @ plane / 2, (one.radius + other.radius) / 2
    for _ in range(_ITERATIONS):
        outward = q - center
        distance = np.linalg.norm(outward, axis=1)
        unit = outward / distance[:, None]
        J = np.column_stack([-unit, -np.ones(len(q))])
        r = distance - radius
        # 1.4826 times the median absolute deviation estimates sigma
        sigma = max(one.sigma, other.sigma, 1.4826 * float(np.median(np.abs(r))))
        weight = 1.0 / (1.0 + (r / (_ROBUST_SIGMAS * sigma)) ** 2) ** 2
        step = -np.linalg.lstsq(J * np.sqrt(weight)[:, None], r * np.sqrt(weight), rcond=1e-6)[0]
        center, radius = center + step[:2], radius + float(step[2])
        # ten nanometers
        if np.abs(step).max() < 1e-8:
            break
    outward = q - center
    distance = np.linalg.norm(outward, axis=1)
    unit = outward / distance[:, None]
    J = np.column_stack([(unit * velocity).sum(axis=1), -unit, -np.ones(len(q))])
    return J, distance - radius, sigma


def _on_one_circle(match: tuple[Hole, Hole]) -> bool:
    one, other = match
    _, r, _ = _circle_residuals(one, other, np.zeros(6))
    return bool(np.sqrt(np.mean(r**2)) < _MAX_RMS_SIGMAS * max(one.sigma, other.sigma))


def _velocity(motion: Floats, points_xyz: Floats) -> Floats:
    """Return (n, 3) displacement of points per unit of a (6,) motion."""
    return np.asarray(np.cross(motion[:3], points_xyz) + motion[3:])
