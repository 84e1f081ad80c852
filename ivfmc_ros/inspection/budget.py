# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budget of one measured value (GUM, JCGM 100:2008, 5.1.2)."""

from collections.abc import Mapping
from dataclasses import dataclass
import math

# Coverage factor of the expanded uncertainty: 95 % for a normal distribution (GUM 6.3).
COVERAGE_FACTOR = 2.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Budget:
    """
    Standard uncertainties of one value by their sources, which are independent of each other.

    components : name of a source to its standard uncertainty, in the unit of the value; NaN where
        it is not known
    """

    components: Mapping[str, float]

    @property
    def standard(self) -> float:
        """Combined standard uncertainty u; NaN if a component is not known."""
        return math.sqrt(sum(value * value for value in self.components.values()))

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U (k = 2)."""
        return COVERAGE_FACTOR * self.standard

    def scaled(self, factor: float) -> 'Budget':
        """Return the budget of the value times a factor."""
        return Budget(components={k: abs(factor) * v for k, v in self.components.items()})
