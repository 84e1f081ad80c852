# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of an inspection to a dictionary of plain values for report.json and report.html."""

from dataclasses import asdict
from typing import Any

from ivfmc_ros.inspection.feature_measurement import FeatureResult
from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.inspect import SurfaceResult
from ivfmc_ros.inspection.settings import InspectSettings


def document(inspection: Inspection, settings: InspectSettings) -> dict[str, Any]:
    """Return all results of an inspection; lengths are meters."""
    return {
        'tolerance_m': settings.tolerance,
        'rule': 'ISO 14253-1, 95 %',
        'verdict': verdict(inspection),
        'uncertainty_of_calibration': inspection.calibrated,
        'alignment': {
            'method': inspection.alignment.method,
            'rms_m': inspection.alignment.rms,
            'nominal_from_mesh': inspection.alignment.nominal_from_mesh.tolist(),
        },
        'conditions': asdict(settings.conditions),
        'unseen': inspection.unseen,
        'notes': inspection.notes,
        'surface': [_surface(result) for result in [inspection.whole, *inspection.regions]],
        'features': [_feature(feature) for feature in inspection.features],
    }


def verdict(inspection: Inspection) -> str:
    """
    Return the overall verdict: fail if any result fails, pass if all pass, else not decided.

    Nothing is decided where the mesh does not lie on the nominal.
    """
    if inspection.misplaced:
        return 'not decided'
    verdicts = {result.verdict for result in [inspection.whole, *inspection.regions]}
    verdicts |= {feature.verdict for feature in inspection.features}
    return next((v for v in ('fail', 'not decided') if v in verdicts), 'pass')


def _surface(result: SurfaceResult) -> dict[str, Any]:
    lengths = asdict(result.deviation)
    count = lengths.pop('count')
    return {
        'name': result.name,
        'vertices': count,
        **{f'{name}_m': value for name, value in lengths.items()},
        'within': result.within,
        'u_m': result.uncertainty,
        'verdict': result.verdict,
    }


def _feature(feature: FeatureResult) -> dict[str, Any]:
    return {
        'name': feature.name,
        'kind': feature.feature.kind,
        'diameter_m': feature.feature.diameter,
        'nominal_m': feature.nominal,
        'form_m': feature.feature.form,
        'rms_m': feature.feature.rms,
        'points': feature.feature.count,
        'u_m': feature.uncertainty,
        'u_noise_m': feature.noise,
        'u_calibration_m': feature.calibration,
        'u_conditions_m': feature.conditions,
        'verdict': feature.verdict,
    }
