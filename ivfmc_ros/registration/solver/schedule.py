# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How long a solution goes on: to the end, or only to where a first placing may stop."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Pace:
    """
    How many steps there are at most, and when they may end.

    coarse : with few patches, for each reach; middle : with all, for each reach but the last
    fine : with the last reach
    still : solved when no view moves by more than this share of a patch's sigma
    """

    coarse: int = 6
    middle: int = 3
    fine: int = 12
    still: float = 0.02


THOROUGH = Pace()
# For a view that is placed while the next one is taken; all are solved for again at the end.
QUICK = Pace(coarse=2, middle=0, fine=3, still=0.3)


def coarse_reaches(reach: float, last: float) -> list[float]:
    """Return reaches from the first to the first that is not above the last, metres."""
    reaches = [reach]
    while reaches[-1] > last:
        reaches.append(reaches[-1] / 2.5)
    return reaches[:-1] if len(reaches) > 1 else reaches
