# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the round holes of two bodies say about a motion that their other surface leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.merge.holes import Bore

# Two holes may be one if their axes are parallel (cosine) and their radii alike.
_PARALLEL, _ALIKE = 0.998, 0.15
# A motion of a metre moves holes that tell of it by so much of it, square to their axes.
_MOVED = 0.2
# Fewer holes in their places could be chance.
_LEAST = 3
# Walls that lie together are off by less than so many sigmas of a point.
_TOGETHER, _ROBUST = 6.0, 2.5
_ROUNDS = 12


@dataclass(frozen=True, kw_only=True)
class Seat:
    """
    Where along a free motion the holes meet.

    amount, sigma : metres of the motion; holes : how many met
    """

    amount: float
    sigma: float
    holes: int


def meetings_along(body: Sequence[Bore], onto: Sequence[Bore], path: Floats, reach: float) -> Ints:
    """
    Return which of the motions (k, 4, 4) bring any hole to another, one of each run.

    The first motion follows the last. One hole is enough: where others are not seen, a place at
    which few meet may be the true one, and must be refuted before another is believed.

    reach : metres, by which axes may miss each other
    """
    alike = np.array([[_alike(one, other) for other in onto] for one in body])
    if not alike.size or not alike.any():
        return np.empty(0, dtype=np.int64)
    centres, axes = (
        np.array([getattr(bore, name) for bore in onto]) for name in ('centre', 'axis')
    )
    own = np.array([bore.axis for bore in body])
    here = np.array([transforms.apply(T, np.array([bore.centre for bore in body])) for T in path])
    parallel = np.abs(np.einsum('kij,bj,oi->kbo', path[:, :3, :3], own, axes)) > _PARALLEL
    gap = here[:, :, None] - centres
    gap = gap - (gap * axes).sum(axis=-1, keepdims=True) * axes
    miss = np.where(alike & parallel, np.linalg.norm(gap, axis=-1), np.inf).min(axis=2)
    level = np.maximum(1.0 - miss / reach, 0.0).sum(axis=1)
    good = np.flatnonzero(level > 0.0)
    runs = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
    if len(runs) > 1 and runs[0][0] == 0 and runs[-1][-1] == len(path) - 1:
        runs[0] = np.concatenate([runs.pop(), runs[0]])
    return np.array([run[np.argmax(level[run])] for run in runs if len(run)], dtype=np.int64)


def _alike(one: Bore, other: Bore) -> bool:
    return abs(one.radius - other.radius) < _ALIKE * max(one.radius, other.radius)


def telling(bores: Sequence[Bore], motion: Floats) -> list[Bore]:
    """Return the holes that a (6,) motion of a metre moves aside."""
    found = []
    for bore in bores:
        way = _velocity(motion, bore.centre[None])[0]
        if np.linalg.norm(way - bore.axis * (way @ bore.axis)) > _MOVED:
            found.append(bore)
    return found


def seat(body: Sequence[Bore], onto: Sequence[Bore], motion: Floats, reach: float) -> Seat | None:
    """
    Return how far along a (6,) motion of a metre the holes meet; None if too few do.

    Each hole is one circle through what both bodies show of its wall.

    reach : metres, by which axes may miss each other at first
    """
    amount = 0.0
    for _ in range(_ROUNDS):
        pairs = _pairs([bore.moved(moved_along(motion, amount)) for bore in body], onto, reach)
        if len(pairs) < _LEAST:
            return None
        step = _solved(pairs, motion)
        amount += step
        if abs(step) < 1e-7:
            break
    here = [bore.moved(moved_along(motion, amount)) for bore in body]
    pairs = [pair for pair in _pairs(here, onto, reach) if _meet(pair)]
    if len(pairs) < _LEAST:
        return None
    every = _solved(pairs, motion)
    without = [_solved(pairs[:k] + pairs[k + 1 :], motion) for k in range(len(pairs))]
    # the jackknife: walls of one hole err together
    spread = np.sqrt((len(pairs) - 1) * np.var(without))
    return Seat(amount=amount + every, sigma=float(spread), holes=len(pairs))


def moved_along(motion: Floats, amount: float) -> Floats:
    """Return (4, 4) of a (6,) motion (rotation vector, translation) followed by an amount."""
    turn, shift = motion[:3], motion[3:]
    rate = float(np.linalg.norm(turn))
    if rate * abs(amount) < 1e-12:
        return transforms.rigid(np.eye(3), amount * shift)
    R = Rotation.from_rotvec(amount * turn).as_matrix()
    point = np.cross(turn, shift) / rate**2
    return transforms.rigid(R, point - R @ point + amount * turn * float(turn @ shift) / rate**2)


def _pairs(body: Sequence[Bore], onto: Sequence[Bore], reach: float) -> list[tuple[Bore, Bore]]:
    pairs = []
    for one in body:
        best, least = None, reach
        for other in onto:
            gap = one.centre - other.centre
            miss = float(np.linalg.norm(gap - other.axis * (gap @ other.axis)))
            if abs(one.axis @ other.axis) > _PARALLEL and _alike(one, other) and miss < least:
                best, least = other, miss
        if best is not None:
            pairs.append((one, best))
    return pairs


def _solved(pairs: Sequence[tuple[Bore, Bore]], motion: Floats) -> float:
    """Return the amount by which the bodies' holes become one circle each with the others'."""
    top = bottom = 0.0
    for one, other in pairs:
        information, pull = _told(one, other, motion)
        bottom, top = bottom + information, top + pull
    return top / bottom


def _told(one: Bore, other: Bore, motion: Floats) -> tuple[float, float]:
    """Return what a hole tells of the amount: its information, and that times the amount."""
    J, r, sigma = _circle_of(one, other, motion)
    weight = 1.0 / (sigma**2 * (1.0 + (r / (_ROBUST * sigma)) ** 2) ** 2)
    N = (J * weight[:, None]).T @ J
    g = J.T @ (weight * r)
    rest = np.linalg.solve(N[1:, 1:], np.column_stack([N[1:, 0], g[1:]]))
    return float(N[0, 0] - N[0, 1:] @ rest[:, 0]), float(-(g[0] - N[0, 1:] @ rest[:, 1]))


def _circle_of(one: Bore, other: Bore, motion: Floats) -> tuple[Floats, Floats, float]:
    """Return how residuals from the common circle change with amount, centre, radius; and them."""
    across = np.linalg.svd(other.axis[None])[2][1:].T
    mine, theirs = one.points_xyz @ across, other.points_xyz @ across
    way = _velocity(motion, one.points_xyz) @ across
    q = np.concatenate([mine, theirs])
    way = np.concatenate([way, np.zeros_like(theirs)])
    centre, radius = (one.centre + other.centre) @ across / 2, (one.radius + other.radius) / 2
    for _ in range(_ROUNDS):
        out = q - centre
        distance = np.linalg.norm(out, axis=1)
        unit = out / distance[:, None]
        J = np.column_stack([-unit, -np.ones(len(q))])
        r = distance - radius
        sigma = max(one.sigma, other.sigma, 1.4826 * float(np.median(np.abs(r))))
        weight = 1.0 / (1.0 + (r / (_ROBUST * sigma)) ** 2) ** 2
        step = -np.linalg.lstsq(J * np.sqrt(weight)[:, None], r * np.sqrt(weight), rcond=1e-6)[0]
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.abs(step).max() < 1e-8:
            break
    out = q - centre
    distance = np.linalg.norm(out, axis=1)
    unit = out / distance[:, None]
    J = np.column_stack([(unit * way).sum(axis=1), -unit, -np.ones(len(q))])
    return J, distance - radius, sigma


def _meet(pair: tuple[Bore, Bore]) -> bool:
    """Tell whether two walls lie on one circle."""
    one, other = pair
    _, r, _ = _circle_of(one, other, np.zeros(6))
    return bool(np.sqrt(np.mean(r**2)) < _TOGETHER * max(one.sigma, other.sigma))


def _velocity(motion: Floats, points_xyz: Floats) -> Floats:
    return np.asarray(np.cross(motion[:3], points_xyz) + motion[3:])
