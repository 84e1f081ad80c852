# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of an inspection."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.scale import scale_u
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.section_plane import MIDDLE_PLANES
from ivfmc_ros.inspection.section_plane import SectionPlane
from ivfmc_ros.inspection.tolerances import Tolerances
from ivfmc_ros.validation import require_in_range

# How a mesh is aligned to its nominal.
ALIGNMENTS = ('best_fit', 'within_tolerance', 'global', 'none', 'datum')
# Meters; points closer to the edge of a region are not judged: the stripe is biased where an edge
# cuts it, and the mesh is rounded over its kernel of 3 voxels.
EDGE = 1.0e-3


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    """
    Settings of an inspection. Lengths are meters.

    tolerance : largest permitted deviation to either side, of surfaces and of diameters
    features : tolerances of single features by name and characteristic, as in ``Tolerances``
    align : one of ``ALIGNMENTS``
    edge : vertices closer to the edge of a region are not judged
    sections : planes in which mesh and nominal are drawn over each other
    vertex_u : stated standard uncertainty of the vertices, of a mesh that was not measured with a
        known cell; taken as common to neighboring vertices
    """

    tolerance: float = 0.1e-3
    features: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    align: str = 'best_fit'
    edge: float = EDGE
    vertex_u: float | None = None
    sections: tuple[SectionPlane, ...] = MIDDLE_PLANES
    conditions: Conditions = field(default_factory=Conditions)

    def __post_init__(self) -> None:
        # checks all values
        _ = self.tolerances
        require_in_range('edge', self.edge, 0.0, 1.0, 'm')
        if self.vertex_u is not None:
            require_in_range('vertex_u', self.vertex_u, 0.0, 1.0, 'm', open_low=True)

    def with_scale_of(self, cell: Cell | None) -> 'InspectSettings':
        """Return the settings with the scale uncertainty that a cell states, if none is set."""
        own = None if cell is None else scale_u(cell.notes, cell.covariance)
        if self.conditions.scale_u or not own:
            return self
        return replace(self, conditions=replace(self.conditions, scale_u=own))

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of all features."""
        return Tolerances(default=self.tolerance, features=self.features)
