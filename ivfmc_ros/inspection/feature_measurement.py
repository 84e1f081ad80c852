# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes fitted to the measured points of each nominal region: size, uncertainty, verdict."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.inspection.verdict import GUARD
from ivfmc_ros.inspection.verdict import judge
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# Points of a fit; more cost time and do not improve it, as errors of neighbors are correlated.
_MAX_POINTS = 20_000
# The points of a region are split into 2**3 = 8 groups for the delete-a-group jackknife.
_HALVINGS = 3
# Points of the jackknife; more do not reduce the correlated error of a group.
_MAX_JACKKNIFE_POINTS = 2_000


@dataclass(frozen=True, eq=False, kw_only=True)
class FeatureResult:
    """
    A shape fitted to the measured points of a region. Lengths are meters.

    name : of the region
    nominal : nominal diameter; NaN for a plane
    uncertainty : standard uncertainty of the diameter; NaN for a plane
    noise, calibration, conditions : its components; noise includes all errors that differ
        between groups of neighboring points (jackknife)
    verdict : of the diameter; of the form error for a plane
    """

    name: str
    feature: features.Feature
    nominal: float
    uncertainty: float
    noise: float
    calibration: float
    conditions: float
    verdict: str


def measure_features(
    regions: Sequence[SurfaceRegion], owner: Ints, comparison: Comparison
) -> list[FeatureResult]:
    """
    Fit to each region that has a shape the same shape through its measured points.

    owner : (n,) index of the region of each vertex, or -1
    returns : without regions whose measured points do not determine the shape
    """
    found = []
    for number, region in enumerate(regions):
        if region.shape is None:
            continue
        inner = _away_from_edges(region, comparison, np.flatnonzero(owner == number))
        try:
            found.append(_measure(region, region.shape, inner, comparison))
        except GeometryError:
            # the measured points of the region do not determine its shape
            continue
    return found


def _away_from_edges(region: SurfaceRegion, comparison: Comparison, chosen: Ints) -> Ints:
    """Return the vertices farther than ``edge`` from other regions, at most ``_MAX_POINTS``."""
    faces = comparison.nominal.faces
    others = np.delete(faces, region.faces, axis=0)
    if len(others) and len(chosen):
        other_regions = Surface(comparison.nominal.vertices_xyz, others)
        is_inner = (
            other_regions.nearest(comparison.vertices_xyz[chosen]).distance
            > comparison.settings.edge
        )
        chosen = chosen[is_inner]
    return np.asarray(chosen[:: max(1, len(chosen) // _MAX_POINTS)])


def _measure(
    region: SurfaceRegion, shape: features.Feature, chosen: Ints, comparison: Comparison
) -> FeatureResult:
    conditions = comparison.settings.conditions
    points = comparison.mesh.vertices_xyz[chosen] * conditions.to_reference
    found = features.fit(shape.kind, points)
    sigma = float(np.sqrt(np.mean(comparison.noise[chosen] ** 2)))
    tolerance = comparison.settings.tolerance
    if shape.kind == 'plane':
        form_u = float(np.median(comparison.uncertainty[chosen]))
        return FeatureResult(
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

    calibration = CalibrationModes(shifts=comparison.modes.shifts[:, chosen]).propagate(
        diameter, points
    )
    noise = jackknife(diameter, points)
    conditions_u = found.diameter * conditions.relative_u
    u = float(np.linalg.norm([calibration, noise, conditions_u]))
    return FeatureResult(
        name=region.name,
        feature=found,
        nominal=shape.diameter,
        uncertainty=u,
        noise=noise,
        calibration=calibration,
        conditions=conditions_u,
        verdict=judge(found.diameter - shape.diameter, u, tolerance),
    )


def jackknife(measure: Callable[[Floats], float], points_xyz: Floats) -> float:
    """
    Return the standard uncertainty of a quantity due to errors of its points.

    Errors of neighboring points are correlated; therefore compact groups of points are left out
    in turn (delete-a-group jackknife: Shao and Tu 1995, The Jackknife and Bootstrap, 2.3). Few
    groups are corrected by Student's t (GUM G.3). Errors common to all points are not included.

    measure : function of (n, 3) points in meters
    :raises GeometryError: the points without one group do not determine the shape
    """
    chosen = points_xyz[:: max(1, len(points_xyz) // _MAX_JACKKNIFE_POINTS)]
    group = split_groups(chosen, _HALVINGS)
    count = int(group.max()) + 1
    values = np.array([measure(chosen[group != k]) for k in range(count)])
    sigma_of_mean = np.sqrt((count - 1) / count * ((values - values.mean()) ** 2).sum())
    return float(sigma_of_mean * stdtrit(count - 1, 0.95) / GUARD)


def split_groups(points_xyz: Floats, halvings: int) -> Ints:
    """Split points (n, 3) into 2**halvings compact groups of equal size; (n,) group indices."""
    group = np.zeros(len(points_xyz), dtype=np.int64)
    for _ in range(halvings):
        halves = np.zeros_like(group)
        for number in range(int(group.max()) + 1):
            inside = np.flatnonzero(group == number)
            longest = int(np.ptp(points_xyz[inside], axis=0).argmax())
            order = inside[np.argsort(points_xyz[inside, longest], kind='stable')]
            halves[order[len(order) // 2 :]] = 1
        group = 2 * group + halves
    return group
