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
# Seconds for which images have to show the beam. Stamps may be late: with a driver that stamps the
# arrival, or a clock that is some tenths of a second ahead, images from before the switch seem
# dark.
_STUCK_AFTER_S = 1.0


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
    dark_ns : stamp of the last image, taken with all lasers off, that shows no beam or cannot be
        compared; 0 before the first
    """

    def __init__(self) -> None:
        self.stuck: int | None = None
        self.checked = 0
        self.dark_ns = 0
        self._lit: dict[int, _LitImage] = {}
        # since when images show the beam, nanoseconds
        self._shining_ns: int | None = None

    def add_lit(self, frame: Frame, profile: Profile) -> None:
        """Keep the last image of a laser in which the stripe was found."""
        self._shining_ns = None
        if len(profile) >= _MIN_POINTS:
            lit = _LitImage(image=frame.image, uv=profile.uv, angle=frame.angle)
            self._lit[frame.laser] = lit

    def add_dark(self, image: Image, angle: float, stamp_ns: int) -> None:
        """
        Judge an image that was exposed with all lasers reported off.

        image : (height, width) or (height, width, 3), of the type of the lit images
        angle : of the table, radians; NaN where it is not known
        stamp_ns : start of exposure, nanoseconds
        """
        ratios = {
            laser: remaining_light(lit.image, image, lit.uv)
            for laser, lit in self._lit.items()
            if _is_same(lit.angle, angle) and lit.image.shape == image.shape
        }
        known = {laser: ratio for laser, ratio in ratios.items() if math.isfinite(ratio)}
        self.checked += bool(known)
        brightest = max(known, key=lambda laser: known[laser], default=None)
        if brightest is None or known[brightest] < _MAX_REMAINING:
            self._shining_ns, self.dark_ns = None, stamp_ns
            if known:
                self.stuck = None
            return
        if self._shining_ns is None:
            self._shining_ns = stamp_ns
        if stamp_ns - self._shining_ns >= _STUCK_AFTER_S * 1e9:
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
    return (
        math.isfinite(second) and abs(math.remainder(first - second, 2.0 * math.pi)) < _SAME_ANGLE
    )
