# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Spheres of known diameter in a scanned surface (Hough transform of the centers).

Every point votes for the center that it would have: its position minus the radius along its
normal. The votes of a sphere meet in one place, whatever holds it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.acceptance.artifact import Artifact
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection.features import fit
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Side of a cell of votes in radii. Normals of a scanned sphere are off by 2 to 4 degrees, which
# moves a vote by 0.04 to 0.07 radii.
_VOTE_CELL = 0.15
# Points of a sphere are within this share of the radius of the nominal sphere, and their normals
# within this angle (cosine) of the radius: a sphere that is 5 % too large is still found.
_BAND = 0.12
_MIN_COSINE = 0.9
# Share of the sphere's surface that must have points for a sphere to count as found,
_MIN_FOUND = 0.08
# and for it to be measured: more than a hemisphere less the rim that fits poorly.
_MIN_COVERAGE = 0.5
_DIRECTIONS = 400  # equal parts of a sphere's surface, by which coverage is counted
# Meters: points nearer to what is not the sphere (stem, bar, platter) are left out, because the
# mesh rounds the edge between both.
_EDGE = 1e-3
_MAX_SPHERES = 6  # more are not searched for
# Factors by which a nominal is wrong that is given in a wrong unit: mm for m, inch for mm.
_UNIT_FACTORS = {1000.0: 'mm given as m', 1e-3: 'm given as mm', 25.4: 'inch given as mm'}


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundSphere:
    """
    A sphere in a scan.

    rows : (n,) indices of its points
    center_xyz : (3,) meters; diameter : meters, of the least-squares sphere
    coverage : share of its surface that has points
    """

    rows: Ints
    center_xyz: Floats
    diameter: float
    coverage: float


def find_spheres(
    artifact: Artifact, points_xyz: Floats, normals: Floats
) -> tuple[FoundSphere, ...]:
    """
    Find the spheres of an artifact.

    points_xyz, normals : (n, 3) meters and outward unit normals of a scan
    returns : as many as the artifact has
    :raises GeometryError: there are more or fewer, or one of them is hidden too far
    """
    found = _search(points_xyz, normals, artifact.diameter)
    if len(found) != artifact.spheres:
        raise GeometryError(_wrong_number(artifact, found, points_xyz, normals))
    for number, sphere in enumerate(found, start=1):
        if sphere.coverage < _MIN_COVERAGE:
            raise GeometryError(
                f'{artifact}: sphere {number} at {_place(sphere.center_xyz)} is half hidden: '
                f'{sphere.coverage:.0%} of its surface was measured, at least '
                f'{_MIN_COVERAGE:.0%} are needed; free it from its holder, or scan a whole turn '
                'with both lasers'
            )
    return found


def _search(points: Floats, normals: Floats, diameter: float) -> tuple[FoundSphere, ...]:
    radius, free = 0.5 * diameter, np.ones(len(points), dtype=bool)
    found: list[FoundSphere] = []
    while len(found) < _MAX_SPHERES:
        rows = np.flatnonzero(free)
        if len(rows) < _DIRECTIONS // 10:
            break
        center = _peak(points[rows] - radius * normals[rows], _VOTE_CELL * radius)
        sphere = _sphere_at(points, normals, free, center, radius)
        if sphere is None:
            break
        found.append(sphere)
        # what is on or in the sphere belongs to it
        free &= np.linalg.norm(points - sphere.center_xyz, axis=1) > radius * (1 + _BAND)
    return tuple(sorted(found, key=lambda one: tuple(one.center_xyz)))


def _peak(votes: Floats, cell: float) -> Floats:
    """Return the (3,) place where most votes meet."""
    key = np.floor(votes / cell).astype(np.int64)
    cells, first, counts = np.unique(key, axis=0, return_index=True, return_counts=True)
    tree = cKDTree(cells)
    # a peak may lie across the border of cells: neighbors count too
    best = np.argsort(-counts)[:50]
    sums = [counts[tree.query_ball_point(cells[index], 1.8)].sum() for index in best]
    middle = (cells[best[int(np.argmax(sums))]] + 0.5) * cell
    near = np.linalg.norm(votes - middle, axis=1) < 1.5 * cell
    return np.asarray(np.median(votes[near], axis=0) if near.any() else votes[first[0]])


def _sphere_at(
    points: Floats, normals: Floats, free: Bools, center: Floats, radius: float
) -> FoundSphere | None:
    """Return the sphere about a first guess of its center; None if there is none."""
    for _ in range(3):
        rows = np.flatnonzero(free & _on_sphere(points, normals, center, radius))
        if len(rows) < 20:
            return None
        try:
            feature = fit('sphere', points[rows])
        except GeometryError:
            return None
        center = feature.center_xyz
    if coverage_of(points[rows] - center) < _MIN_FOUND:
        return None
    rows = _away_from_others(points, rows, center, radius)
    if len(rows) < 20:
        return None
    feature = fit('sphere', points[rows])
    return FoundSphere(
        rows=rows,
        center_xyz=feature.center_xyz,
        diameter=feature.diameter,
        coverage=coverage_of(points[rows] - feature.center_xyz),
    )


def _on_sphere(points: Floats, normals: Floats, center: Floats, radius: float) -> Bools:
    arm = points - center
    distance = np.linalg.norm(arm, axis=1)
    facing = (arm * normals).sum(axis=1) > _MIN_COSINE * distance
    return np.asarray((np.abs(distance - radius) < _BAND * radius) & facing)


def _away_from_others(points: Floats, rows: Ints, center: Floats, radius: float) -> Ints:
    near = np.linalg.norm(points - center, axis=1) < radius * (1 + _BAND) + 2 * _EDGE
    near[rows] = False
    if not near.any():
        return rows
    distance, _ = cKDTree(points[near]).query(points[rows])
    return np.asarray(rows[distance > _EDGE])


def coverage_of(arms: Floats) -> float:
    """Return the share of a sphere's surface near which there is a point; arms : (n, 3)."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * number / _DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number  # Fibonacci lattice
    ring = np.sqrt(1.0 - z * z)
    lattice = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    unit = arms / np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), 1e-30)
    # each direction stands for a cap of 4 pi / count; its radius is 2 / sqrt(count)
    distance, _ = cKDTree(unit).query(lattice)
    return float(np.mean(distance < 2.0 / np.sqrt(_DIRECTIONS)))


def _wrong_number(
    artifact: Artifact, found: Sequence[FoundSphere], points: Floats, normals: Floats
) -> str:
    if len(found) > artifact.spheres:
        places = ' and '.join(_place(sphere.center_xyz) for sphere in found)
        return (
            f'{artifact}: the artifact has {artifact.spheres} sphere(s), the scan {len(found)}: '
            f'at {places}; take the others away, or name the artifact that it is'
        )
    text = (
        f'{artifact}: {len(found)} of {artifact.spheres} spheres of '
        f'{artifact.diameter * 1e3:.4g} mm found'
    )
    for factor, reason in _UNIT_FACTORS.items():
        if _search(points, normals, artifact.diameter * factor):
            return (
                f'{text}; one of {artifact.diameter * factor * 1e3:.4g} mm fits: is the diameter '
                f'in the wrong unit ({reason}), or the mesh (--unit)?'
            )
    return f'{text}; is it in the working volume, matt, and is the diameter right?'


def _place(center: Floats) -> str:
    x, y, z = center * 1e3
    return f'({x:.1f}, {y:.1f}, {z:.1f}) mm'
