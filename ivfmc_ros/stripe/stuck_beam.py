# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Finds a laser that shines although it is reported off, in images that are taken afterwards.

A relay that welds or a transistor that fails leaves the beam on, and no report of the controller
says so. The camera sees it: where the last lit image has its stripe, an image of the same table
position that is taken with the lasers off must be as dark as its surroundings.
"""

from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile

# Points of a stripe, and its median height in 8-bit DN, below which it proves nothing.
_MIN_POINTS = 20
_MIN_HEIGHT_DN = 3.0
# Share of the stripe's light that is left from which the laser is on. A laser that is off leaves
# none; noise leaves less than a hundredth of a stripe of 20 points.
_MAX_REMAINING = 0.2
# Pixels from the stripe at which the surroundings are sampled, on both sides.
_BESIDE_PX = 20
# Table angles that differ by less, radians, show the stripe at the same pixels.
_SAME_ANGLE = 2e-3
# Images in a row that show the beam: the first after the switch may overlap with it.
_CONFIRMATIONS = 2
# Dark images after a lit one that are compared: decoding a compressed one takes 10 ms.
_ENOUGH = 5


@dataclass(frozen=True, eq=False, kw_only=True)
class _LitImage:
    image: Image
    uv: Floats
    angle: float


class StuckBeamCheck:
    """
    Compares images taken with all lasers off with the last lit image of each laser.

    stuck : index of a laser that shines although it is reported off; None if none does
    checked : images that were taken with all lasers off and could be compared
    """

    def __init__(self) -> None:
        self.stuck: int | None = None
        self.checked = 0
        self._lit: dict[int, _LitImage] = {}
        self._in_a_row = self._since_lit = 0

    def add_lit(self, frame: Frame, profile: Profile) -> None:
        """Keep the last image of a laser in which the stripe was found."""
        self._in_a_row = self._since_lit = 0
        if len(profile) >= _MIN_POINTS:
            lit = _LitImage(image=frame.image, uv=profile.uv, angle=frame.angle)
            self._lit[frame.laser] = lit

    def wants(self, angle: float) -> bool:
        """
        Return whether an image at this table angle (radians) is to be compared.

        A few after each lit image are; more of them only while they show the beam.
        """
        is_open = self._since_lit < _ENOUGH or self._in_a_row > 0
        return is_open and any(_is_same(lit.angle, angle) for lit in self._lit.values())

    def add_dark(self, image: Image, angle: float) -> None:
        """
        Judge an image that was exposed with all lasers reported off.

        image : (height, width) or (height, width, 3), of the type of the lit images
        angle : of the table, radians
        """
        ratios = {
            laser: remaining_light(lit.image, image, lit.uv)
            for laser, lit in self._lit.items()
            if _is_same(lit.angle, angle) and lit.image.shape == image.shape
        }
        known = {laser: ratio for laser, ratio in ratios.items() if math.isfinite(ratio)}
        if not known:
            return
        self.checked += 1
        self._since_lit += 1
        brightest = max(known, key=lambda laser: known[laser])
        if known[brightest] < _MAX_REMAINING:
            self._in_a_row, self.stuck = 0, None
            return
        self._in_a_row += 1
        if self._in_a_row >= _CONFIRMATIONS:
            self.stuck = brightest


def remaining_light(lit: Image, dark: Image, uv: Floats) -> float:
    """
    Return the light at the stripe in ``dark`` relative to that in ``lit``.

    Light is the median excess over the brighter of the surroundings on either side, so that
    ambient light and steps of reflectance count on both sides alike.

    lit, dark : (height, width) or (height, width, 3), images of the same shape and type
    uv : (n, 2) pixels (column, row) of the stripe in ``lit``
    :returns: 1 for the same light, 0 for none; NaN where the stripe is too short or too weak
    """
    if len(uv) < _MIN_POINTS:
        return math.nan
    full = _excess(lit, uv)
    scale = float(np.iinfo(lit.dtype).max) / 255.0
    if full < _MIN_HEIGHT_DN * scale:
        return math.nan
    return _excess(dark, uv) / full


def _excess(image: Image, uv: Floats) -> float:
    """Return the median of the stripe's gray values above those beside it."""
    gray = image if image.ndim == 2 else image.max(axis=2)
    height, width = gray.shape
    column, row = np.round(uv).astype(int).T
    column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
    # a stripe of many rows runs along them, one of many columns across
    along_rows = len(np.unique(row)) >= len(np.unique(column))
    beside = []
    for side in (-_BESIDE_PX, _BESIDE_PX):
        shift = (side, 0) if along_rows else (0, side)
        c = np.clip(column + shift[0], 0, width - 1)
        r = np.clip(row + shift[1], 0, height - 1)
        beside.append(gray[r, c].astype(float))
    center = gray[row, column].astype(float)
    return float(np.median(center - np.maximum(beside[0], beside[1])))


def _is_same(first: float, second: float) -> bool:
    return abs(math.remainder(first - second, 2.0 * math.pi)) < _SAME_ANGLE
