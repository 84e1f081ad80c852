# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Features that are fitted to what was measured of a region: size, uncertainty, verdict."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.compared import Compared
from ivfmc_ros.inspection.regions import Region
from ivfmc_ros.inspection.uncertainty import Modes
from ivfmc_ros.inspection.verdict import GUARD
from ivfmc_ros.inspection.verdict import judge
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

_MOST_POINTS = 20_000
# Neighbouring vertices share their errors: a face is cut into so many patches (two to this power),
# and how the fit changes when one is left out tells how sure it is.
_HALVINGS = 3
# Points for that; more of them do not make a patch's own error smaller.
_FOR_PATCHES = 2_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Sized:
    """
    A feature fitted to the measured points of a region, and judged by its diameter.

    uncertainty : standard, of the diameter, metres; NaN for a plane, which is judged by its form
    noise, calibration, conditions : what it is made of; noise holds all that differs from patch
        to patch of the face, such as what an edge nearby does to the stripe
    """

    name: str
    feature: features.Feature
    nominal: float
    uncertainty: float
    noise: float
    calibration: float
    conditions: float
    verdict: str


def sizes(regions: Sequence[Region], owner: Ints, compared: Compared) -> list[Sized]:
    """
    Fit its own shape to what was measured of each region.

    owner : (n,) of each vertex the number of its region, or -1
    """
    found = []
    for number, region in enumerate(regions):
        if region.shape is None:
            continue
        inner = _away_from_edges(region, compared, np.flatnonzero(owner == number))
        try:
            found.append(_sized(region, region.shape, inner, compared))
        except GeometryError:
            # too little of the face was seen to fit its shape
            continue
    return found


def _away_from_edges(region: Region, compared: Compared, chosen: Ints) -> Ints:
    """Leave out vertices near the edges of a region, and thin the rest."""
    faces = compared.nominal.faces
    others = np.delete(faces, region.faces, axis=0)
    if len(others) and len(chosen):
        beside = Surface(compared.nominal.vertices_xyz, others)
        far = beside.nearest(compared.vertices_xyz[chosen]).distance > compared.settings.edge
        chosen = chosen[far]
    return np.asarray(chosen[:: max(1, len(chosen) // _MOST_POINTS)])


def _sized(region: Region, shape: features.Feature, chosen: Ints, compared: Compared) -> Sized:
    conditions = compared.settings.conditions
    points = compared.mesh.vertices_xyz[chosen] * conditions.to_reference
    found = features.fit(shape.kind, points)
    sigma = float(np.sqrt(np.mean(compared.noise[chosen] ** 2)))
    tolerance = compared.settings.tolerance
    if shape.kind == 'plane':
        form_u = float(np.median(compared.uncertainty[chosen]))
        return Sized(
            name=region.name,
            feature=found,
            nominal=float('nan'),
            uncertainty=float('nan'),
            noise=sigma,
            calibration=float('nan'),
            conditions=0.0,
            verdict=judge(0.5 * found.form, form_u, tolerance),
        )

    def diameter(xyz: Floats) -> float:
        return features.fit(shape.kind, xyz).diameter

    calibration = Modes(shifts=compared.modes.shifts[:, chosen]).of(diameter, points)
    noise = jackknife(diameter, points)
    warm = found.diameter * conditions.relative_u
    u = float(np.linalg.norm([calibration, noise, warm]))
    return Sized(
        name=region.name,
        feature=found,
        nominal=shape.diameter,
        uncertainty=u,
        noise=noise,
        calibration=calibration,
        conditions=warm,
        verdict=judge(found.diameter - shape.diameter, u, tolerance),
    )


def jackknife(measure: Callable[[Floats], float], points_xyz: Floats) -> float:
    """
    Return the standard uncertainty of what ``measure`` says of (n, 3) points.

    Errors of neighbours go together, so that the points of one patch after the other are left
    out (delete-a-group jackknife: Shao and Tu 1995, The Jackknife and Bootstrap, 2.3); few
    patches tell their own spread poorly, which Student's t makes up for (GUM G.3). What moves all
    points alike does not show.

    :raises GeometryError: the points without one patch are no shape
    """
    chosen = points_xyz[:: max(1, len(points_xyz) // _FOR_PATCHES)]
    patch = patches(chosen, _HALVINGS)
    count = int(patch.max()) + 1
    told = np.array([measure(chosen[patch != k]) for k in range(count)])
    spread = np.sqrt((count - 1) / count * ((told - told.mean()) ** 2).sum())
    return float(spread * stdtrit(count - 1, 0.95) / GUARD)


def patches(points_xyz: Floats, halvings: int) -> Ints:
    """Return (n,) numbers of 2**halvings compact patches of as many points each."""
    patch = np.zeros(len(points_xyz), dtype=np.int64)
    for _ in range(halvings):
        halves = np.zeros_like(patch)
        for number in range(int(patch.max()) + 1):
            inside = np.flatnonzero(patch == number)
            longest = int(np.ptp(points_xyz[inside], axis=0).argmax())
            order = inside[np.argsort(points_xyz[inside, longest], kind='stable')]
            halves[order[len(order) // 2 :]] = 1
        patch = 2 * patch + halves
    return patch
