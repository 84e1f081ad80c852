# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is fixed when a scan is accepted: its id, folder, request, plan and limits."""

from dataclasses import dataclass
from pathlib import Path

from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.resume import InterruptedScan
from ivfmc_ros.scan.view_coverage import CompletenessLimits


@dataclass(frozen=True, kw_only=True)
class ScanContext:
    """
    The constants of a running scan.

    cell : path of cell.yaml
    cell_name : namespace of its nodes
    tolerance : of table positions, radians
    patience : seconds without progress towards a profile after which the scan fails
    home : home the table first
    reserve : bytes of the disk that stay free
    limits : what a complete view has at least
    recipe : judged by its copy in ``folder``; None without one
    resumed : the interrupted scan that goes on; None for a new one
    """

    scan_id: str
    folder: Path
    request: ScanRequest
    plan: Plan
    motion: MotionLimits
    cell: Path
    cell_name: str
    tolerance: float
    patience: float
    home: bool
    reserve: float
    limits: CompletenessLimits
    recipe: Recipe | None = None
    resumed: InterruptedScan | None = None

    @property
    def inspects(self) -> bool:
        """Whether the recipe judges the mesh."""
        return self.recipe is not None and self.recipe.inspection is not None
