# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report page of an inspection: deviations on the mesh, and all its figures."""

from collections.abc import Mapping
from typing import Any

from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.reports.html import Page
from ivfmc_ros.inspection.settings import InspectSettings


def inspection_page(
    title: str, found: Inspection, settings: InspectSettings, figures: Mapping[str, Any]
) -> Page:
    """Return the page; ``figures`` as in report.json. Colors end at twice the tolerance."""
    return Page(
        title=title,
        vertices_xyz=found.vertices_xyz,
        faces=found.faces,
        values=found.deviations,
        span=2.0 * settings.tolerance,
        figures=figures,
    )
