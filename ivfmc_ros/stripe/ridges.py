# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for a thin stripe beside or on top of broad light, in pictures with inter-reflections.

Light that was reflected twice between two faces of metal makes a broad, bright area; the directly
lit stripe beside it is dim, but as thin as elsewhere and unbroken. A pixel is therefore judged by
its contrast: the mean over the width of the stripe less the brighter of the means to both sides
of it, in sigmas of its noise. The evidence of thin candidates is summed along the stripe by a
path search (dynamic programming, ``path_search``) in which a row may also be empty.
"""

from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Any
from typing import cast

import cv2
import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.path_search import path_costs

# Candidates of a row: the stripe, and maxima of noise or of broad light that may exceed it.
CANDIDATES = 4
# Widths of the middle box and of the boxes beside it, and the distance of their centers, in sigmas
# of the stripe: the middle box holds 3/4 of its light, the others 1 %.
_MIDDLE_SIGMAS, _SIDE_SIGMAS, _DISTANCE_SIGMAS = 2.4, 2.6, 3.5
# Rows over which a contrast is averaged: a stripe that goes on by a pixel a row loses little.
_ROWS = 3
# Distance from a candidate, in sigmas of the stripe, within which there is no other.
_BLANKED_SIGMAS = 2.5
# Least contrast of a candidate, in sigmas of the read noise of a pixel.
_LEAST_CONTRAST = 1.5
# Contrasts above this many sigmas count alike: broad light is the brighter one.
_MAX_CONTRAST = 6.0
# Gain of a candidate: half of its squared contrast less this. A contrast of 2.6 sigmas, which a
# row of a few hundred pixels shows by chance, gains nothing.
_CHANCE = 1.5
# Loss of a candidate as wide as e^0.35 times the stripe: 0.5, and the greatest loss, which exceeds
# any gain. The logarithm of a width is uncertain by the second number over the contrast.
_WIDTH_SCALE, _WIDTH_NOISE, _MAX_WIDTH_LOSS = 0.35, 2.0, 20.0
# Cost of a step of this many pixels from row to row, and more; of a change to or from empty rows.
_STEP_COST, _MAX_STEP = 6.0, 4.0
_EMPTY_COST = 3.0
_INFINITE_COST = 1e6


@dataclass(frozen=True, eq=False)
class Ridges:
    """
    Candidates of every row, (rows, ``CANDIDATES``) each, and which of them is on the path.

    column : int64, pixels; contrast : in sigmas of its noise, -inf where there is none
    height : gray values of 0 to 255, contrast not divided by its noise
    width : pixels, sigma of a Gaussian of the same contrast at two scales
    chosen : (rows,) int64 index of the candidate on the path, -1 for an empty row
    """

    column: Ints
    contrast: Singles
    height: Singles
    width: Singles
    chosen: Ints


@dataclass(frozen=True)
class _Boxes:
    """Pixels: widths of the middle and the side box (odd), distance of their centers."""

    middle: int
    side: int
    distance: int

    @classmethod
    def of(cls, sigma: float) -> '_Boxes':
        middle, side = (
            2 * int(max(sigmas * sigma, 1.0) / 2) + 1 for sigmas in (_MIDDLE_SIGMAS, _SIDE_SIGMAS)
        )
        return cls(middle, side, round(max(_DISTANCE_SIGMAS * sigma, 3.0)))

    @property
    def reach(self) -> int:
        return self.distance + self.side // 2


def find_ridges(
    gray: Image,
    scale: float,
    dark: float,
    mask: Bytes | None,
    sigma: float,
    noise: SensorNoise,
) -> Ridges:
    """
    Return the thin candidates of every row and the path along the stripe.

    gray : (rows, columns) uint8 or uint16
    scale : factor from ``gray`` to gray values of 0 to 255
    dark : gray value without laser, scaled
    mask : (rows, columns) uint8, 0 where no stripe can be; None for everywhere
    sigma : pixels, of the directly lit stripe
    """
    boxes = _Boxes.of(sigma)
    middle, contrast = _contrast_image(gray, boxes)
    row, at = _maxima(contrast, mask, scale, sigma, noise)
    height = scale * contrast[row, at].astype(np.float32)
    light = scale * middle[row, at].astype(np.float32)
    variance = noise.variance(light, np.maximum(light - np.float32(dark), 0.0))
    pixels = _ROWS / (1.0 / boxes.middle + 1.0 / boxes.side)
    of_noise = height / np.sqrt(variance / np.float32(pixels))
    column, found = _highest(row, at, of_noise, len(gray))
    height, width = _measured(gray, scale, column, np.isfinite(found), sigma)
    return Ridges(column, found, height, width, _path(column, found, width, sigma))


def _contrast_image(gray: Image, boxes: _Boxes) -> tuple[Image, Image]:
    """Return the means over the middle box, and by how much they exceed both sides (or 0)."""
    middle, side = (
        cv2.blur(gray, (size, _ROWS), borderType=cv2.BORDER_REPLICATE)
        for size in (boxes.middle, boxes.side)
    )
    away, width = boxes.distance, gray.shape[1]
    wide = cv2.copyMakeBorder(side, 0, 0, away, away, cv2.BORDER_REPLICATE)
    brighter = cv2.max(wide[:, :width], wide[:, 2 * away :])
    # of unsigned pixels: a difference below 0 becomes 0
    return cast(Image, middle), cast(Image, cv2.subtract(middle, brighter))


def _maxima(
    contrast: Image, mask: Bytes | None, scale: float, sigma: float, noise: SensorNoise
) -> tuple[Ints, Ints]:
    """Return row and column of the maxima along rows that may exceed the noise, (n,) each."""
    size = 2 * int(np.ceil(_BLANKED_SIGMAS * sigma)) + 1
    least = max(_LEAST_CONTRAST * noise.read / scale, 1.0)
    _, high = cv2.threshold(contrast, math.ceil(least) - 1, 0, cv2.THRESH_TOZERO)
    highest = cv2.dilate(high, np.ones((1, size), dtype=np.uint8))
    # all bits where a pixel is the highest around, and those of its contrast, which is not 0
    maxima = cv2.compare(high, highest, cv2.CMP_EQ)
    if high.dtype == np.uint8:
        maxima = cv2.bitwise_and(maxima, high)
    else:
        maxima[high == 0] = 0
    if mask is not None:
        maxima = cv2.bitwise_and(maxima, mask)
    if not cv2.countNonZero(maxima):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    # ten times faster than np.nonzero
    at, row = cv2.findNonZero(maxima).reshape(-1, 2).T.astype(np.int64)
    return row, at


def _highest(row: Ints, at: Ints, contrast: Singles, rows: int) -> tuple[Ints, Singles]:
    """Return columns and contrasts of the highest candidates of each row, (rows, CANDIDATES)."""
    order = np.lexsort((-contrast, row))
    row, at, contrast = row[order], at[order], contrast[order]
    starts = np.searchsorted(row, np.arange(rows))
    rank = np.arange(len(row)) - starts[row]
    kept = rank < CANDIDATES
    column = np.zeros((rows, CANDIDATES), dtype=np.int64)
    found = np.full(column.shape, -np.inf, dtype=np.float32)
    column[row[kept], rank[kept]] = at[kept]
    found[row[kept], rank[kept]] = contrast[kept]
    return column, found


def _measured(
    gray: Image, scale: float, column: Ints, found: Bools, sigma: float
) -> tuple[Singles, Singles]:
    """Return height and width of candidates from their contrast at two scales; 0 if not found."""
    narrow, wide = _Boxes.of(sigma), _Boxes.of(2.0 * sigma)
    steps = np.arange(-wide.reach, wide.reach + 1)
    row, number = np.nonzero(found)
    columns = np.clip(column[row, number][:, None] + steps, 0, gray.shape[1] - 1)
    around = np.clip(row[:, None] + np.arange(_ROWS) - _ROWS // 2, 0, len(gray) - 1)
    pixels = gray[around[:, :, None], columns[:, None]].mean(axis=1, dtype=np.float32)
    sums = [_box_contrast(pixels, boxes) for boxes in (narrow, wide)]
    height, width = np.zeros((2, *column.shape), dtype=np.float32)
    ratios, sigmas = _ratio_table(sigma)
    height[row, number] = scale * sums[0]
    width[row, number] = np.interp(sums[1] / np.maximum(sums[0], 1e-3), ratios, sigmas)
    return height, width


def _box_contrast(pixels: Any, boxes: _Boxes) -> Any:
    """Return the contrast at the middle of the last axis, against the mean of both sides."""
    center = pixels.shape[-1] // 2
    a, b = boxes.middle // 2, boxes.side // 2

    def mean(at: int, half: int) -> Any:
        return pixels[..., at - half : at + half + 1].mean(axis=-1)

    sides = 0.5 * (mean(center - boxes.distance, b) + mean(center + boxes.distance, b))
    return mean(center, a) - sides


@lru_cache(maxsize=64)
def _ratio_table(sigma: float) -> tuple[Floats, Floats]:
    """Return ratios of the contrasts at both scales, ascending, and the sigma of each."""
    narrow, wide = _Boxes.of(sigma), _Boxes.of(2.0 * sigma)
    sigmas = np.geomspace(0.3 * sigma, 8.0 * sigma, 60)
    steps = np.arange(-wide.reach, wide.reach + 1)
    pixels = np.exp(-0.5 * (steps / np.hypot(sigmas, 0.29)[:, None]) ** 2)
    ratios = _box_contrast(pixels, wide) / _box_contrast(pixels, narrow)
    return np.maximum.accumulate(ratios), sigmas


def _path(column: Ints, contrast: Singles, width: Singles, sigma: float) -> Ints:
    """Return the candidate of each row on the best path, -1 for empty rows."""
    chosen = np.full(len(column), -1)
    # rows without candidates are empty on any path
    rows = np.flatnonzero(np.isfinite(contrast).any(axis=1))
    if not len(rows):
        return chosen
    nodes = _node_costs(contrast[rows], width[rows], sigma)
    transitions = _transition_costs(column[rows], rows)
    forward = path_costs(nodes[0], transitions + nodes.T[None, :, 1:])
    # the cost of a node belongs to the row that is entered: backward, to the one before
    back = transitions + nodes.T[:, None, 1:].swapaxes(0, 1)
    start = np.zeros(CANDIDATES + 1, np.float32)
    backward = path_costs(start, back[..., ::-1].swapaxes(0, 1))
    best = (forward + backward[:, ::-1]).argmin(axis=0)
    chosen[rows] = np.where(best == CANDIDATES, -1, best)
    return chosen


def _node_costs(contrast: Singles, width: Singles, sigma: float) -> Singles:
    """Return the cost of each candidate, and of an empty row, (rows, CANDIDATES + 1)."""
    found = np.isfinite(contrast)
    limited = np.clip(np.where(found, contrast, 0.0), 0.0, _MAX_CONTRAST)
    stretch = np.log(np.where(found, width, sigma) / sigma)
    doubt = np.hypot(_WIDTH_SCALE, _WIDTH_NOISE / np.maximum(limited, 1.0))
    loss = np.minimum(0.5 * (stretch / doubt) ** 2, _MAX_WIDTH_LOSS)
    nodes = np.zeros((len(contrast), CANDIDATES + 1), dtype=np.float32)
    nodes[:, :-1] = np.where(found, _CHANCE - 0.5 * limited**2 + loss, _INFINITE_COST)
    return nodes


def _transition_costs(column: Ints, rows: Ints) -> Singles:
    """Return the costs from candidate a of a row to b of the next, (a, b, rows - 1)."""
    step = np.abs(column.T[None, :, 1:] - column.T[:, None, :-1]) / _MAX_STEP
    # between them lies an empty row
    step[..., np.diff(rows) > 1] = 1.0
    shape = CANDIDATES + 1, CANDIDATES + 1, len(rows) - 1
    transitions = np.full(shape, _EMPTY_COST, dtype=np.float32)
    transitions[:-1, :-1] = _STEP_COST * np.minimum(step * step, 1.0)
    transitions[-1, -1] = 0.0
    return transitions
