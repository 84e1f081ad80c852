# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes fitted to the measured points of the nominal's regions: size, form, position."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.characteristics import characteristics_of
from ivfmc_ros.inspection.characteristics import FeatureCharacteristic
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.feature_fit import ErringPoints
from ivfmc_ros.inspection.feature_fit import fit_feature
from ivfmc_ros.inspection.regions import SurfaceRegion
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import NO_UNCERTAINTY
from ivfmc_ros.inspection.verdict import NOT_DECIDED
from ivfmc_ros.inspection.verdict import NOT_MEASURED
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Points of a fit; more cost time and do not improve it, as errors of neighbors are correlated.
_MAX_POINTS = 20_000
_MIN_POINTS = 40  # of a feature
# Sectors around the axis of a cylinder, and how many of them must hold points: 150 degrees.
_SECTORS, _MIN_SECTORS = 36, 15
# A cylinder whose points extend along its axis by less than this many diameters has the direction
# of the nominal: a short band does not determine it.
_MIN_LENGTH = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class FeatureResult:
    """
    A shape fitted to the measured points of a region, in the frame of the nominal.

    name : of the region
    nominal : shape of the region
    feature : fitted shape; None if the points do not suffice
    coverage : fraction of the region's area whose points were used
    axis_is_nominal : the direction of the axis was taken from the nominal
    characteristics : diameter, form and position, as far as the shape has them
    reason : why there is no fitted shape; '' if there is one
    """

    name: str
    nominal: features.Feature
    feature: features.Feature | None
    coverage: float
    axis_is_nominal: bool
    characteristics: tuple[FeatureCharacteristic, ...]
    reason: str = ''

    @property
    def verdict(self) -> str:
        """The worst verdict of the characteristics."""
        found = {item.verdict for item in self.characteristics}
        order = (FAIL, NO_UNCERTAINTY, NOT_DECIDED, PASS)
        return next((verdict for verdict in order if verdict in found), NOT_MEASURED)


def measure_features(
    regions: Sequence[SurfaceRegion], comparison: Comparison
) -> list[FeatureResult]:
    """Fit to each region that has a shape the same shape through its well measured points."""
    return [
        measure_feature(region, number, region.shape, comparison)
        for number, region in enumerate(regions)
        if region.shape is not None
    ]


def measure_feature(
    region: SurfaceRegion, number: int, shape: features.Feature, comparison: Comparison
) -> FeatureResult:
    """
    Fit a shape to the well measured points of a region.

    number : index of the region; shape : of the region
    """
    tolerance = comparison.settings.tolerances.of(region.name, 'diameter')
    good = _without_great_bias(number, tolerance, comparison)
    found = FeatureResult(
        name=region.name,
        nominal=shape,
        feature=None,
        coverage=min(float(comparison.area[good].sum()) / region.area, 1.0),
        axis_is_nominal=False,
        characteristics=(),
    )
    chosen = np.flatnonzero(good)
    chosen = chosen[:: max(1, len(chosen) // _MAX_POINTS)]
    points = comparison.vertices_xyz[chosen]
    reason = _insufficient(shape, points)
    if reason:
        return replace(found, reason=reason)
    along = (points - shape.center_xyz) @ shape.axis
    fixed = shape.kind == 'cylinder' and bool(np.ptp(along) < _MIN_LENGTH * shape.diameter)
    axis = shape.axis if shape.kind == 'cylinder' else None
    try:
        fitted = fit_feature(shape.kind, _erring(chosen, comparison), axis, fixed=fixed)
    except GeometryError as error:
        return replace(found, reason=str(error))
    return replace(
        found,
        feature=fitted.shape,
        axis_is_nominal=fixed,
        characteristics=characteristics_of(
            region.name, shape, fitted, points, comparison.settings, region.facet_depth
        ),
    )


def _without_great_bias(number: int, tolerance: float, comparison: Comparison) -> Bools:
    """Return (n,) bool, the inner vertices of a region that neither edge nor shadow displaces."""
    with np.errstate(invalid='ignore'):
        biased = 6.0 * comparison.uncertainty.systematic > tolerance
    own = (comparison.owner == number) & comparison.measured & comparison.inner
    return np.asarray(own & ~biased)


def _insufficient(shape: features.Feature, points: Floats) -> str:
    """Return why points do not determine a shape, or ''."""
    if len(points) < _MIN_POINTS:
        return f'{len(points)} points are measured well, {_MIN_POINTS} are needed'
    if shape.kind != 'cylinder':
        return ''
    basis = np.linalg.svd(shape.axis[None])[2][1:]
    x, y = basis @ (points - shape.center_xyz).T
    sectors = np.unique(np.floor(np.arctan2(y, x) / (2.0 * np.pi) * _SECTORS))
    if len(sectors) >= _MIN_SECTORS:
        return ''
    degrees = 360 // _SECTORS
    return (
        f'points around {degrees * len(sectors)} degrees are measured well, '
        f'{degrees * _MIN_SECTORS} are needed'
    )


def _erring(chosen: Ints, comparison: Comparison) -> ErringPoints:
    R = comparison.nominal_from_mesh[:3, :3]
    normals = comparison.normals[chosen]
    known = np.isfinite(comparison.uncertainty.combined[chosen]).all()
    modes = comparison.model.modes(comparison.mesh.vertices_xyz[chosen], normals)
    if comparison.settings.vertex_u is not None:
        # the stated uncertainty of the vertices contains that of the calibration
        modes = CalibrationModes(shifts=np.zeros((0, len(chosen), 3)))
    elif modes is not None:
        modes = replace(modes, shifts=modes.shifts @ R.T)
    return ErringPoints(
        points_xyz=comparison.vertices_xyz[chosen],
        normals=normals @ R.T,
        systematic=np.nan_to_num(comparison.uncertainty.systematic[chosen]),
        modes=modes if known else None,
    )
