# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations and verdicts of the regions of a nominal surface, with the share that decides."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.inspection.budget import Budget
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarize
from ivfmc_ros.inspection.verdict import judge_surface
from ivfmc_ros.inspection.verdict import NOT_MEASURED
from ivfmc_ros.model import Bools

# Fraction of a region that must be measured well before it is judged.
_MIN_COVERAGE = 0.05
# Square meters: a smaller patch of vertices outside the tolerance is a stray. The stripe of 1.4 mm
# (4 sigma of a sheet of 0.35 mm) does not resolve anything smaller.
_STRAY_AREA = 0.5e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceResult:
    """
    Deviations and verdict of a region or of the whole surface.

    deviation : of the vertices that decide, or of all if none does, weighted by their area
    within : fraction of their area within tolerance
    coverage : fraction of the area that decides: measured, away from edges, and with an expanded
        uncertainty of at most a third of the tolerance
    budget : medians over the vertices that decide
    """

    name: str
    deviation: Deviation
    within: float
    coverage: float
    tolerance: float
    budget: Budget
    verdict: str


def measure_surface(
    name: str, chosen: Bools, area: float, comparison: Comparison
) -> SurfaceResult:
    """
    Judge the deviations of chosen vertices.

    chosen : (n,) bool, vertices of the region, at least one of which was measured
    area : square meters, of the nominal region
    """
    tolerance = comparison.settings.tolerances.of(name, 'surface')
    own = chosen & comparison.measured
    deciding = own & comparison.is_measured_well(tolerance)
    coverage = min(float(comparison.area[deciding].sum()) / area, 1.0)
    used = deciding if deciding.any() else own
    deviations = comparison.deviations[used]
    u = comparison.uncertainty.combined[used]
    areas = comparison.area[used]
    weights = areas if areas.any() else None
    verdict = NOT_MEASURED
    if coverage >= _MIN_COVERAGE:
        strays = int(_STRAY_AREA / max(float(np.median(areas)), 1e-12))
        verdict = judge_surface(deviations, u, tolerance, min(strays, len(u) // 20))
    return SurfaceResult(
        name=name,
        deviation=summarize(deviations, weights),
        within=float(np.average(np.abs(deviations) <= tolerance, weights=weights)),
        coverage=coverage,
        tolerance=tolerance,
        budget=Budget(components=comparison.uncertainty.medians(used)),
        verdict=verdict,
    )
