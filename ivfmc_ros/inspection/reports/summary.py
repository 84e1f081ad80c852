# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of an inspection to a dictionary of plain values for report.json and report.html."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ivfmc_ros.inspection.budget import Budget
from ivfmc_ros.inspection.budget import COVERAGE_FACTOR
from ivfmc_ros.inspection.characteristics import FeatureCharacteristic
from ivfmc_ros.inspection.feature_measurement import FeatureResult
from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.missing_surface import MissingSurface
from ivfmc_ros.inspection.section_cut import SectionCut
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.surface_measurement import SurfaceResult
from ivfmc_ros.inspection.verdict import NOT_DECIDED
from ivfmc_ros.inspection.verdict import NOT_MEASURED
from ivfmc_ros.inspection.verdict import overall


def document(inspection: Inspection, settings: InspectSettings) -> dict[str, Any]:
    """
    Return all results of an inspection; lengths are meters.

    ``number`` is that of the region in the drawings of the page; the whole surface has none.
    """
    numbers = {name: number for number, name in enumerate(inspection.region_names, 1)}
    return {
        'tolerance_m': settings.tolerance,
        'rule': f'ISO 14253-1, 95 %; U is the expanded uncertainty, k = {COVERAGE_FACTOR:g}',
        'verdict': verdict(inspection),
        'coverage': inspection.whole.coverage,
        'uncertainty_of_calibration': inspection.calibrated,
        'alignment': {
            'method': inspection.alignment.method,
            'rms_m': inspection.alignment.rms,
            'nominal_from_mesh': inspection.alignment.nominal_from_mesh.tolist(),
        },
        'conditions': asdict(settings.conditions),
        'unseen': inspection.unseen,
        'missing': _missing(inspection.missing),
        'notes': inspection.notes,
        'surface': [
            _surface(result, numbers) for result in [inspection.whole, *inspection.regions]
        ],
        'characteristics': [
            _characteristic(feature, item, numbers)
            for feature in inspection.features
            for item in feature.characteristics
        ],
        'features': [_feature(feature, numbers) for feature in inspection.features],
        'sections': [_section(cut) for cut in inspection.sections],
        'budget': _budgets(inspection),
    }


def verdict(inspection: Inspection) -> str:
    """
    Return the overall verdict: fail if any result fails, pass if all that was measured well does.

    Nothing is decided where the mesh does not lie on the nominal.
    """
    if inspection.misplaced:
        return NOT_DECIDED
    verdicts = {result.verdict for result in [inspection.whole, *inspection.regions]}
    return overall(verdicts | {feature.verdict for feature in inspection.features})


def _missing(missing: MissingSurface | None) -> dict[str, Any] | None:
    if missing is None:
        return None
    poses = [
        {'rests_on': list(one.rests_on), 'down': one.down.tolist(), 'shows': one.shows}
        for one in missing.poses
    ]
    return {'share': missing.share, 'poses': poses}


def _surface(result: SurfaceResult, numbers: Mapping[str, int]) -> dict[str, Any]:
    lengths = asdict(result.deviation)
    count = lengths.pop('count')
    return {
        'number': numbers.get(result.name),
        'name': result.name,
        'vertices': count,
        **{f'{name}_m': value for name, value in lengths.items()},
        'within': result.within,
        'coverage': result.coverage,
        'U_m': result.budget.expanded,
        'tolerance_m': result.tolerance,
        'verdict': result.verdict,
    }


def _characteristic(
    feature: FeatureResult, item: FeatureCharacteristic, numbers: Mapping[str, int]
) -> dict[str, Any]:
    return {
        'number': numbers[feature.name],
        'feature': feature.name,
        'characteristic': item.name,
        'nominal_m': item.nominal,
        'measured_m': item.measured,
        'deviation_m': item.deviation,
        'U_m': item.budget.expanded,
        'tolerance_m': item.tolerance,
        'verdict': item.verdict,
    }


def _feature(feature: FeatureResult, numbers: Mapping[str, int]) -> dict[str, Any]:
    found = feature.feature
    shape = feature.nominal if found is None else found
    return {
        'number': numbers[feature.name],
        'name': feature.name,
        'kind': shape.kind,
        'position_m': shape.center_xyz.tolist(),
        'axis': shape.axis.tolist() if np.isfinite(shape.axis).all() else None,
        'axis_is_nominal': feature.axis_is_nominal,
        'points': 0 if found is None else found.count,
        'rms_m': float('nan') if found is None else found.rms,
        'coverage': feature.coverage,
        'verdict': feature.verdict,
        'reason': feature.reason or (NOT_MEASURED if not feature.characteristics else ''),
    }


def _section(cut: SectionCut) -> dict[str, Any]:
    return {
        'name': cut.name,
        'axis': cut.axis,
        'offset_m': cut.offset,
        'rms_m': cut.rms,
        'worst_m': cut.worst,
        'worst_U_m': cut.worst_u,
        'U_m': cut.median_u,
        'judged_length_m': cut.judged_length,
        'nominal_length_m': cut.nominal_length,
    }


def _budgets(inspection: Inspection) -> list[dict[str, Any]]:
    """Return a row for each value: what contributes how much to its standard uncertainty."""
    rows = [
        _budget_row(result.name, 'surface', result.budget)
        for result in [inspection.whole, *inspection.regions]
    ]
    rows += [
        _budget_row(feature.name, item.name, item.budget)
        for feature in inspection.features
        for item in feature.characteristics
    ]
    # the same columns in every row
    sources = dict.fromkeys(key for row in rows for key in row if key.endswith('_m'))
    names = [key for key in sources if key != 'u_m']
    return [
        {
            'feature': row['feature'],
            'characteristic': row['characteristic'],
            **{key: row.get(key) for key in names},
            'u_m': row['u_m'],
        }
        for row in rows
    ]


def _budget_row(name: str, characteristic: str, budget: Budget) -> dict[str, Any]:
    parts = {f'{source.replace(" ", "_")}_m': u for source, u in budget.components.items()}
    return {'feature': name, 'characteristic': characteristic, **parts, 'u_m': budget.standard}
