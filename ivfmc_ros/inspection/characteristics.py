# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Characteristics of a fitted feature: nominal, measured value, budget, tolerance and verdict."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.budget import Budget
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.feature_fit import FeatureFit
from ivfmc_ros.inspection.form import form_error
from ivfmc_ros.inspection.form import roundness
from ivfmc_ros.inspection.form import straightness
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.verdict import judge
from ivfmc_ros.inspection.verdict import NOT_MEASURED
from ivfmc_ros.model import Floats

# Half width of a uniform distribution in its standard deviations (GUM 4.3.7).
_UNIFORM = float(np.sqrt(3.0))
_FORMS = {'plane': 'flatness', 'cylinder': 'cylindricity', 'sphere': 'sphericity'}


@dataclass(frozen=True, eq=False, kw_only=True)
class FeatureCharacteristic:
    """
    One value of a feature. Lengths are meters.

    name : one of ``tolerances.CHARACTERISTICS``
    nominal : 0 for form and position
    tolerance : greatest deviation to either side, or width of the zone of form and position
    """

    name: str
    nominal: float
    measured: float
    budget: Budget
    tolerance: float
    verdict: str

    @property
    def deviation(self) -> float:
        """Measured value minus nominal."""
        return self.measured - self.nominal


def characteristics_of(
    name: str,
    nominal: features.Feature,
    fitted: FeatureFit,
    points_xyz: Floats,
    settings: InspectSettings,
    facet_depth: float = 0.0,
) -> tuple[FeatureCharacteristic, ...]:
    """
    Return size, position and form of a feature.

    name : of the feature, for its tolerances
    points_xyz : (n, 3) meters, of the fit
    facet_depth : meters, mean distance of the nominal's faces from its shape
    """
    sizes = _size(name, nominal, fitted, settings, facet_depth)
    found = [*sizes, *_position(name, nominal, fitted, settings)]
    return (*found, *_form(name, fitted, points_xyz, settings))


def _size(
    name: str,
    nominal: features.Feature,
    fitted: FeatureFit,
    settings: InspectSettings,
    facet_depth: float,
) -> Iterator[FeatureCharacteristic]:
    if not np.isfinite(nominal.diameter):
        return
    measured = fitted.shape.diameter
    budget = _with_conditions(
        fitted.budget(lambda shape: shape.diameter), measured, settings.conditions
    )
    if facet_depth > 0.0:
        # the nominal is between the shape through its vertices and its faces
        facets = {'nominal facets': 2.0 * facet_depth / _UNIFORM}
        budget = Budget(components={**budget.components, **facets})
    tolerance = settings.tolerances.of(name, 'diameter')
    yield FeatureCharacteristic(
        name='diameter',
        nominal=nominal.diameter,
        measured=measured,
        budget=budget,
        tolerance=tolerance,
        verdict=judge(measured - nominal.diameter, budget.standard, tolerance),
    )


def _position(
    name: str, nominal: features.Feature, fitted: FeatureFit, settings: InspectSettings
) -> Iterator[FeatureCharacteristic]:
    """Yield the diameter of the zone around the true position that holds the measured axis."""
    if nominal.kind not in {'cylinder', 'sphere'}:
        return
    offset = _offset(nominal, fitted.shape)
    distance = float(np.linalg.norm(offset))
    direction = offset / max(distance, 1e-12)
    budget = fitted.budget(lambda shape: float(_offset(nominal, shape) @ direction)).scaled(2.0)
    tolerance = settings.tolerances.of(name, 'position')
    yield FeatureCharacteristic(
        name='position',
        nominal=0.0,
        measured=2.0 * distance,
        budget=budget,
        tolerance=tolerance,
        verdict=judge(2.0 * distance, budget.standard, tolerance),
    )


def _offset(nominal: features.Feature, shape: features.Feature) -> Floats:
    """Return the offset of the center, or of the axis where its points are, (3,) meters."""
    offset = shape.center_xyz - nominal.center_xyz
    if nominal.kind == 'cylinder':
        offset = offset - (offset @ nominal.axis) * nominal.axis
    return np.asarray(offset)


def _form(
    name: str, fitted: FeatureFit, points_xyz: Floats, settings: InspectSettings
) -> Iterator[FeatureCharacteristic]:
    shape = fitted.shape
    whole = form_error(points_xyz, features.residuals(shape, points_xyz))
    found = {_FORMS[shape.kind]: whole}
    if shape.kind == 'cylinder':
        found['roundness'] = roundness(shape, points_xyz)
        found['straightness'] = straightness(shape, points_xyz)
    for form, error in found.items():
        budget = Budget(components={'noise': error.noise_u, **fitted.form_components})
        tolerance = settings.tolerances.of(name, form)
        few = not np.isfinite(error.value)
        if few and form != _FORMS[shape.kind]:
            # a short band has no lines, a narrow one no section
            continue
        verdict = NOT_MEASURED if few else judge(error.value, budget.standard, tolerance)
        yield FeatureCharacteristic(
            name=form,
            nominal=0.0,
            measured=error.value,
            budget=budget,
            tolerance=tolerance,
            verdict=verdict,
        )


def _with_conditions(budget: Budget, value: float, conditions: Conditions) -> Budget:
    more = {
        'scale': abs(value) * conditions.scale_u,
        'temperature': abs(value) * conditions.temperature_relative_u,
    }
    return Budget(components={**budget.components, **more})
