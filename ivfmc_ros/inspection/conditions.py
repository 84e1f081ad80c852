# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions of a measurement that scale all lengths: the reference length and the temperature."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.validation import require_in_range

REFERENCE_TEMPERATURE = 20.0  # degrees Celsius, ISO 1


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """
    Measurement conditions that scale all lengths.

    scale_u : relative standard uncertainty of the reference length of the calibration
    temperature, temperature_u : temperature of the part, degrees Celsius, and its standard
        uncertainty, K
    expansion, expansion_u : coefficient of thermal expansion and its standard uncertainty, 1/K;
        steel by default
    """

    scale_u: float = 0.0
    temperature: float = REFERENCE_TEMPERATURE
    temperature_u: float = 0.0
    expansion: float = 11.5e-6
    expansion_u: float = 1.0e-6

    def __post_init__(self) -> None:
        require_in_range('scale_u', self.scale_u, 0.0, 0.1)
        require_in_range('temperature', self.temperature, -50.0, 200.0, 'C')
        require_in_range('temperature_u', self.temperature_u, 0.0, 50.0, 'K')
        require_in_range('expansion', self.expansion, 0.0, 1e-3, '1/K')

    @property
    def to_reference(self) -> float:
        """Factor from a length at ``temperature`` to that at 20 degrees Celsius (ISO 1)."""
        return 1.0 / (1.0 + self.expansion * (self.temperature - REFERENCE_TEMPERATURE))

    @property
    def temperature_relative_u(self) -> float:
        """Relative standard uncertainty of a length due to temperature and expansion."""
        difference = self.temperature - REFERENCE_TEMPERATURE
        return float(np.hypot(self.expansion * self.temperature_u, difference * self.expansion_u))

    @property
    def relative_u(self) -> float:
        """Relative standard uncertainty of a length due to scale and temperature."""
        return float(np.hypot(self.scale_u, self.temperature_relative_u))
