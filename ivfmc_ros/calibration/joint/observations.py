# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is seen in the pictures of a joint calibration, and a subset of it by pictures."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

Keep = Callable[[str], bool]


@dataclass(frozen=True, eq=False, kw_only=True)
class StripePixels:
    """
    Stripe of one laser in one picture.

    laser : index
    uv : (n, 2) pixels
    sigma : pixels, 1 sigma of a stripe position
    """

    laser: int
    uv: Floats
    sigma: float


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardPicture:
    """One picture of the board that is held by hand; ``stripe`` if a laser is on it."""

    name: str
    corners: Corners
    stripe: StripePixels | None


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterCorners:
    """
    Corners of the target on the platter.

    names : (pictures,) of the pictures
    corners : one row each, ``uv`` without lens distortion
    pixels : (n, 2) with lens distortion
    """

    target: Target
    names: tuple[str, ...]
    corners: CornerObservations
    pixels: Floats

    def select(self, keep: Keep) -> tuple['PlatterCorners', Ints]:
        """Return the part of the chosen pictures, and the indices of these."""
        chosen = np.array([number for number, name in enumerate(self.names) if keep(name)])
        index = np.full(len(self.names), -1)
        index[chosen] = np.arange(len(chosen))
        rows = index[self.corners.picture] >= 0
        part = self.corners.select(rows)
        return PlatterCorners(
            target=self.target,
            names=tuple(self.names[number] for number in chosen),
            corners=replace(part, picture=index[part.picture]),
            pixels=self.pixels[rows],
        ), chosen


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterStripe:
    """The stripe of one laser on the bare platter in one picture."""

    name: str
    stripe: StripePixels


@dataclass(frozen=True, eq=False, kw_only=True)
class JointObservations:
    """All that a joint calibration adjusts to."""

    board: Board
    pictures: tuple[BoardPicture, ...]
    platter: PlatterCorners
    platter_stripes: tuple[PlatterStripe, ...]

    def select(self, keep: Keep) -> 'JointObservations':
        """Return the part of those pictures for whose name ``keep`` is true."""
        return JointObservations(
            board=self.board,
            pictures=tuple(picture for picture in self.pictures if keep(picture.name)),
            platter=self.platter.select(keep)[0],
            platter_stripes=tuple(seen for seen in self.platter_stripes if keep(seen.name)),
        )

    def names(self) -> Sequence[str]:
        """Return the names of all pictures, in order, each once."""
        listed = (
            *(picture.name for picture in self.pictures),
            *self.platter.names,
            *(seen.name for seen in self.platter_stripes),
        )
        return list(dict.fromkeys(listed))
