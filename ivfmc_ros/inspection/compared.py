# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh that lies on its nominal: what regions and features are judged by."""

from dataclasses import dataclass

from ivfmc_ros.inspection.nominal import Body
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.uncertainty import Modes
from ivfmc_ros.model import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class Compared:
    """
    The vertices of a mesh on its nominal.

    vertices_xyz (n, 3), deviations (n,) and uncertainty (n,) metres in the frame of the nominal;
        deviations of vertices that were not measured are NaN
    noise : (n,) metres; modes : how the calibration moves the vertices
    """

    mesh: Body
    vertices_xyz: Floats
    deviations: Floats
    uncertainty: Floats
    modes: Modes
    noise: Floats
    settings: InspectSettings
    nominal: Body
