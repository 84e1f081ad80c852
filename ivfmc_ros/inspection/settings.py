# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of an inspection."""

from dataclasses import dataclass
from dataclasses import field

from ivfmc_ros.inspection.uncertainty import Conditions
from ivfmc_ros.inspection.verdict import require_tolerance

# Meters; points closer to the edge of a region are not used for its shape: the stripe is biased
# where an edge cuts it.
EDGE = 1.0e-3


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    """
    Settings of an inspection. Lengths are meters.

    tolerance : largest permitted deviation to either side, of the surface and of diameters
    align : best_fit, global or none
    edge : vertices closer to the edge of a region are not used for its fitted shape
    """

    tolerance: float = 0.1e-3
    align: str = 'best_fit'
    edge: float = EDGE
    conditions: Conditions = field(default_factory=Conditions)

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)
