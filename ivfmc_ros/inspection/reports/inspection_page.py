# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report page of an inspection: labeled views, features with their budgets, all figures."""

from collections.abc import Mapping
from datetime import datetime
from datetime import UTC
import math
from typing import Any

from ivfmc_ros import __version__
from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.drawings import view_figure
from ivfmc_ros.inspection.reports.feature_views import labeled_views
from ivfmc_ros.inspection.reports.html import Page
from ivfmc_ros.inspection.reports.section_drawings import section_figure
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.verdict import overall

# Micrometers: a budget is read at a glance.
_UM = 1e6
# Of the largest source; smaller ones are in the table of the budget.
_MIN_SHARE = 0.02


def inspection_page(
    title: str,
    found: Inspection,
    settings: InspectSettings,
    figures: Mapping[str, Any],
    heading: Mapping[str, str] | None = None,
) -> Page:
    """
    Return the page; colors end at twice the tolerance.

    figures : as in report.json
    heading : what was measured, when and by which cell; None for the figures' own names
    """
    bar = ColorBar(
        low=-2.0 * settings.tolerance,
        high=2.0 * settings.tolerance,
        quantity='deviation',
        tolerance=settings.tolerance,
    )
    verdicts = {name: _verdict(name, figures) for name in found.region_names}
    return Page(
        title=title,
        vertices_xyz=found.vertices_xyz,
        faces=found.faces,
        values=found.deviations,
        span=bar.high,
        tolerance=settings.tolerance,
        figures={**figures, 'characteristics': feature_rows(figures)},
        heading=_heading(figures, settings, heading or {}),
        drawings=[
            view_figure(view, found.region_names, verdicts)
            for view in labeled_views(found, bar, verdicts)
        ],
        sections=[section_figure(cut, settings.tolerance) for cut in found.sections],
    )


def feature_rows(figures: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the characteristics with the position of their feature and their budget."""
    positions = {row['name']: row['position_m'] for row in figures['features']}
    budgets = {(row['feature'], row['characteristic']): row for row in figures['budget']}
    rows = []
    for row in figures['characteristics']:
        first = {key: row[key] for key in ('number', 'feature')}
        budget = budgets[row['feature'], row['characteristic']]
        rows.append(
            {
                **first,
                'position_m': positions[row['feature']],
                **{key: value for key, value in row.items() if key not in first},
                'budget_of_u': _budget(budget),
            }
        )
    return rows


def _budget(row: Mapping[str, Any]) -> str:
    """Return the standard uncertainties that add something, the largest first."""
    parts = {
        key[:-2].replace('_', ' '): value
        for key, value in row.items()
        if key.endswith('_m') and key != 'u_m' and value
    }
    unknown = [name for name, value in parts.items() if math.isnan(value)]
    known = sorted(
        ((name, value) for name, value in parts.items() if not math.isnan(value)),
        key=lambda item: -item[1],
    )
    texts = [
        f'{name} {value * _UM:.2g} µm' for name, value in known if value > _MIN_SHARE * known[0][1]
    ]
    # a budget may have a part that it can only call not known
    texts += [name if name == 'not known' else f'{name} not known' for name in unknown]
    return ', '.join(texts)


def _verdict(name: str, figures: Mapping[str, Any]) -> str:
    """Return the verdict on a region: of its surface and of the feature in it."""
    rows = [row for row in [*figures['surface'], *figures['features']] if row['name'] == name]
    return overall({row['verdict'] for row in rows}) if rows else ''


def _heading(
    figures: Mapping[str, Any], settings: InspectSettings, given: Mapping[str, str]
) -> dict[str, str]:
    conditions = settings.conditions
    scale = f'{conditions.scale_u:.2g} (1 sigma)' if conditions.scale_u else 'not stated'
    own = {
        'mesh': str(figures.get('mesh', '')),
        'nominal': str(figures.get('nominal', '')),
        'tolerance': f'±{settings.tolerance * 1e3:g} mm',
        'alignment': figures['alignment']['method'].replace('_', ' '),
        'part at': f'{conditions.temperature:.4g} °C (u = {conditions.temperature_u:.2g} K)',
        'uncertainty of scale': scale,
        'inspected (UTC)': f'{datetime.now(UTC):%Y-%m-%d %H:%M:%S}',
        'software': f'ivfmc_ros {__version__}',
    }
    merged = {name: text for name, text in {**given, **own}.items() if text}
    return {**{name: text for name, text in merged.items() if name != 'operator'}, 'operator': ''}
