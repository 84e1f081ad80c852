# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Convergence schedule of the registration: iterations and tolerance of each phase."""

from dataclasses import dataclass

# Factor between two successive correspondence distances of the coarse-to-fine schedule.
_SHRINK = 2.5


@dataclass(frozen=True, kw_only=True)
class ConvergenceSchedule:
    """
    Maximum iterations of each phase, and the tolerance that ends a phase.

    coarse : with a subset of the surfels, at each correspondence distance
    middle : with all surfels, at each distance but the last; 0 skips the phase
    fine : with all surfels, at the last distance
    tolerance : converged when no view moves by more than this share of a surfel's sigma
    """

    coarse: int = 6
    middle: int = 3
    fine: int = 12
    tolerance: float = 0.02


THOROUGH = ConvergenceSchedule()
# For a view that is registered while the next one is being taken. The final registration solves
# for all views again.
QUICK = ConvergenceSchedule(coarse=2, middle=0, fine=3, tolerance=0.3)


def coarse_distances(first: float, last: float) -> list[float]:
    """Return decreasing correspondence distances from ``first`` to above ``last``, meters."""
    distances = [first]
    while distances[-1] > last:
        distances.append(distances[-1] / _SHRINK)
    return distances[:-1] if len(distances) > 1 else distances
