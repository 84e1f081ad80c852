# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a mesh is compared with its nominal."""

from dataclasses import dataclass
from dataclasses import field

from ivfmc_ros.inspection.uncertainty import Conditions
from ivfmc_ros.inspection.verdict import require_tolerance

# Points of a feature are taken so far away from the edges of its face, in metres: the stripe bends
# over an edge.
EDGE = 1.0e-3


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    """
    How a mesh is judged. Lengths are metres.

    tolerance : largest deviation allowed to either side, of surface and sizes
    align : best_fit, global, none
    edge : vertices nearer to the edge of a face have no part in its fitted feature
    """

    tolerance: float = 0.1e-3
    align: str = 'best_fit'
    edge: float = EDGE
    conditions: Conditions = field(default_factory=Conditions)

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)
