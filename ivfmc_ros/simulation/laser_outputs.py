# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two outputs of an emulated motion controller that lasers are wired to."""

from dataclasses import dataclass

LASER_OUTPUTS = 2


@dataclass(frozen=True, kw_only=True)
class LaserOutputs:
    """
    Power of the outputs; their names are those of GRBL.

    spindle : of the first output, 0 to 1 of full power (Marlin: fan0, Horus and FabScan: laser1)
    coolant : of the second one, 0 or 1 (Marlin: fan1, Horus and FabScan: laser2)
    """

    spindle: float = 0.0
    coolant: float = 0.0
