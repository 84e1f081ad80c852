# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What came of a planned view, and what a complete one has at least."""

from dataclasses import dataclass
import math
from typing import Any

from ivfmc_ros.scan.angle_ranges import degrees_of
from ivfmc_ros.scan.angle_ranges import Range
from ivfmc_ros.validation import require_in_range

# Meters; no stripe resolves less, and a scan of such steps takes hours.
MIN_SPACING = 1e-5


@dataclass(frozen=True, kw_only=True)
class CompletenessLimits:
    """
    What a complete view has at least.

    max_gap : greatest difference in angle of neighboring profiles, in planned steps
    min_profiles : share of the planned profiles that were received, 0 to 1
    min_stripe : share of the profiles that have a point, 0 to 1; a part that is off the axis is
        not in the light sheet at all angles
    max_spacing : meters, greatest distance of neighboring profiles on the part; 0: any
    """

    max_gap: float = 3.5
    min_profiles: float = 0.6
    min_stripe: float = 0.05
    max_spacing: float = 0.0

    def __post_init__(self) -> None:
        require_in_range('max_gap', self.max_gap, 1.5, 1e6)
        require_in_range('min_profiles', self.min_profiles, 0.0, 1.0)
        require_in_range('min_stripe', self.min_stripe, 0.0, 1.0)
        if self.max_spacing:
            require_in_range('max_spacing', self.max_spacing, MIN_SPACING, 1.0, 'm')


@dataclass(frozen=True, kw_only=True)
class ViewCoverage:
    """
    What came of a planned view, the views that were taken again included.

    planned, profiles : planned and received number of profiles in the planned range of angles
    largest_gap : greatest difference in angle of neighboring profiles, radians
    missing : ranges of angles without profiles, radians of the table position
    spacing : greatest distance of neighboring profiles on the part, meters; 0 without points
    stripe : share of the profiles that have a point
    retaken : numbers of the views that were taken again
    why : why the view is incomplete, '' where it is complete
    """

    view: int
    laser: str
    planned: int
    profiles: int
    largest_gap: float
    missing: tuple[Range, ...]
    spacing: float
    stripe: float
    retaken: tuple[int, ...] = ()
    why: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-serializable values; angles in degrees."""
        return {
            'view': self.view,
            'laser': self.laser,
            'planned': self.planned,
            'profiles': self.profiles,
            'largest_gap_deg': round(math.degrees(self.largest_gap), 2),
            'largest_spacing_mm': round(1e3 * self.spacing, 3),
            'missing_deg': [degrees_of(hole) for hole in self.missing],
            'stripe_share': round(self.stripe, 3),
            'retaken_as': list(self.retaken),
        }


def incomplete_reason(found: ViewCoverage, limits: CompletenessLimits) -> str:
    """Return why a view is incomplete, '' where it is complete."""
    name = f'view {found.view} (laser {found.laser})'
    if found.missing:
        texts = [f'{low} to {high} degrees' for low, high in map(degrees_of, found.missing)]
        return f'{name}: no profiles from {", ".join(texts)}'
    if found.profiles < limits.min_profiles * found.planned:
        return f'{name}: {found.profiles} of {found.planned} profiles were received'
    if found.stripe < limits.min_stripe:
        return (
            f'{name}: only {100.0 * found.stripe:.1f} % of the profiles have a stripe; check '
            'laser and exposure'
        )
    if limits.max_spacing and found.spacing > limits.max_spacing:
        return (
            f'{name}: neighboring profiles are up to {1e3 * found.spacing:.2f} mm apart on the '
            f'part, max_spacing is {1e3 * limits.max_spacing:.2f} mm'
        )
    return ''
