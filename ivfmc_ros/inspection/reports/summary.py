# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An inspection as a document of plain numbers, for ``report.json`` and ``report.html``."""

from dataclasses import asdict
from typing import Any

from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.inspect import Judged
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.sizes import Sized


def document(found: Inspection, settings: InspectSettings) -> dict[str, Any]:
    """Return all figures of an inspection; lengths are metres."""
    return {
        'tolerance_m': settings.tolerance,
        'rule': 'ISO 14253-1, 95 %',
        'verdict': verdict(found),
        'uncertainty_of_calibration': found.calibrated,
        'alignment': {
            'method': found.alignment.method,
            'rms_m': found.alignment.rms,
            'nominal_from_mesh': found.alignment.nominal_from_mesh.tolist(),
        },
        'conditions': asdict(settings.conditions),
        'unseen': found.unseen,
        'surface': [_surface(judged) for judged in [found.whole, *found.regions]],
        'features': [_feature(sized) for sized in found.sizes],
    }


def verdict(found: Inspection) -> str:
    """Return fail if anything fails, pass if everything passes."""
    verdicts = {judged.verdict for judged in [found.whole, *found.regions]}
    verdicts |= {sized.verdict for sized in found.sizes}
    return next((v for v in ('fail', 'not decided') if v in verdicts), 'pass')


def _surface(judged: Judged) -> dict[str, Any]:
    lengths = asdict(judged.deviation)
    count = lengths.pop('count')
    return {
        'name': judged.name,
        'vertices': count,
        **{f'{name}_m': value for name, value in lengths.items()},
        'within': judged.within,
        'u_m': judged.uncertainty,
        'verdict': judged.verdict,
    }


def _feature(sized: Sized) -> dict[str, Any]:
    return {
        'name': sized.name,
        'kind': sized.feature.kind,
        'diameter_m': sized.feature.diameter,
        'nominal_m': sized.nominal,
        'form_m': sized.feature.form,
        'rms_m': sized.feature.rms,
        'points': sized.feature.count,
        'u_m': sized.uncertainty,
        'u_noise_m': sized.noise,
        'u_calibration_m': sized.calibration,
        'u_conditions_m': sized.conditions,
        'verdict': sized.verdict,
    }
