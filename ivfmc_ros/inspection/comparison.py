# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh aligned to its nominal, with deviations and uncertainty: input of all verdicts."""

from dataclasses import dataclass

from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.model import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """
    A mesh aligned to its nominal. Positions are in the frame of the nominal.

    mesh : as measured, in its own frame
    vertices_xyz : (n, 3) meters, aligned and corrected to the reference temperature
    deviations : (n,) meters; NaN at vertices that were not measured
    uncertainty : (n,) meters, standard uncertainty of the deviations
    modes : displacement of the vertices by each principal error of the calibration
    noise : (n,) meters, 1 sigma of each vertex without the calibration
    """

    mesh: MeshBody
    vertices_xyz: Floats
    deviations: Floats
    uncertainty: Floats
    modes: CalibrationModes
    noise: Floats
    settings: InspectSettings
    nominal: MeshBody
