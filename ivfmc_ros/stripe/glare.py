# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Stripe positions in pictures with inter-reflections, where broad light lies beside and under it.

The candidates come from ``ridges``. What lies under the stripe is interpolated linearly between
its two sides and taken off before the fit; as laser light it has speckle, which the weights of the
fit know. A row whose stripe is not as wide as the path along it lets expect is left empty.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe import quality
from ivfmc_ros.stripe.cropped_image import CroppedImage
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.peaks import Peaks
from ivfmc_ros.stripe.ridges import find_ridges
from ivfmc_ros.stripe.ridges import Ridges
from ivfmc_ros.stripe.settings import ExtractSettings

# Light beside a stripe, this many of its sigmas from its middle, and the light farther away with
# which it is compared: a Gaussian has nothing at either place.
_NEAR_SIGMAS = np.linspace(3.5, 6.0, 6)
_FAR_SIGMAS = np.linspace(12.0, 20.0, 6)
# A row shows glare if the light beside its stripe exceeds this fraction of its height, and this
# gray value, three sigmas of the read noise.
_GLARE_FRACTION, _GLARE_LEVEL = 0.15, 6.0
# Fraction of ``max_uncertainty`` above which positions are dropped. On the development half of
# ``bench metal`` (rough aluminium), 5 % of the points below the whole limit are off by more than
# 0.1 mm, 0.7 % of those below this one.
UNCERTAINTY_FRACTION = 0.65
# Share of the rows from which pictures are taken to show inter-reflections.
_GLARE_SHARE = 0.03
# The directly lit stripe is the thinnest: this quantile of the widths of all rows.
_WIDTH_QUANTILE = 0.15
# Its limits, pixels: those of the setting ``expected_width``.
_WIDTH_LIMITS = (0.3, 50.0)
# Places beside a stripe between which the light under it is interpolated, in its sigmas.
_SIDE_SIGMAS = np.linspace(3.0, 5.0, 5)
# Rows to each side over which that light, and the width, are averaged.
_MEAN_ROWS = 3
# The same farther away: where slope or level differ, that light is no straight line either
# between the nearer places.
_OUTER_SIGMAS = np.linspace(5.0, 8.0, 6)
# 1 sigma of the position, in widths of the stripe: per change of slope times width over height,
# per change of level over height, and per excess of the relative width over a tolerance. Chosen
# on the development half of ``bench metal``.
_BEND_FACTOR, _BULGE_FACTOR, _WIDTH_FACTOR, _WIDTH_TOLERANCE = 14.0, 3.0, 1.0, 0.35
# Rows to each side of the line that is fitted to positions whose noise exceeds this fraction of
# the width of the stripe; and the greatest reduced chi^2 of a line: a corner has more.
_LINE_ROWS, _NOISY, _MAX_CHI2 = 6, 0.06, 1.6
# Rows over which the slope of the path is measured, to each side.
_SLOPE_ROWS = 4
# Greatest slope, pixels a row, for which a stripe is taken to be widened.
_MAX_SLOPE = 3.0
# Least and greatest mean width of an accepted stripe, as a multiple of the expected one; and the
# greatest where the light beside it, at these distances in its own sigmas, is less than this
# fraction of its height: broad light has such tails, a stripe on a slanted surface has none.
_MIN_WIDTH, _MAX_WIDTH, _MAX_CLEAN_WIDTH = 0.5, 1.8, 2.6
_TAIL_SIGMAS = np.linspace(3.0, 4.5, 4)
_MAX_TAIL = 0.02
# Fewest rows of an accepted piece of the stripe, and the least sum of their contrasts: a path
# through the maxima of noise and of broad light, which are about 3, ends after a few rows.
_MIN_ROWS, _MIN_EVIDENCE = 5, 40.0
# Rows at both ends of a piece that are dropped: an edge cuts the stripe there, or a corner bends
# it in the middle of the brightest light.
_END_ROWS = 2


def shows_glare(crop: CroppedImage, rows: Ints, u: Floats, width: Floats, height: Floats) -> Bools:
    """
    Return (n,) bool: which rows have broad light beside the stripe found in them.

    rows, u : row and column of the crop; width : pixels; height : gray values
    """
    width = np.maximum(width, 1.0)
    near = np.maximum(*_beside(crop, rows, u, width, _NEAR_SIGMAS))
    far = np.minimum(*_beside(crop, rows, u, width, _FAR_SIGMAS))
    excess = near - far
    return np.asarray((excess > _GLARE_FRACTION * height) & (excess > _GLARE_LEVEL))


def is_glaring(glare: Bools) -> bool:
    """Tell whether enough rows show glare that pictures are searched for a thin stripe."""
    return bool(len(glare) and np.mean(glare) > _GLARE_SHARE)


def expected_width(width: Floats) -> float | None:
    """Return the sigma of the directly lit stripe in pixels from the widths of all rows."""
    if not len(width):
        return None
    return float(np.clip(np.quantile(width, _WIDTH_QUANTILE), *_WIDTH_LIMITS))


@dataclass(frozen=True, eq=False)
class ThinStripe:
    """
    Patches around a thin stripe, without the light under it, (n,) each.

    rows : ascending, of the crop
    expected : pixels, width that the stripe has if it is the directly lit one
    contrast : in sigmas of its noise
    bend : gray values per pixel, change of slope of the light under the stripe
    bulge : gray values, by which this light is higher near the stripe than farther away
    """

    rows: Ints
    patches: Patches
    expected: Floats
    contrast: Singles
    bend: Floats
    bulge: Floats

    def __getitem__(self, chosen: Bools) -> 'ThinStripe':
        return ThinStripe(
            self.rows[chosen],
            self.patches,
            self.expected[chosen],
            self.contrast[chosen],
            self.bend[chosen],
            self.bulge[chosen],
        )


@dataclass(frozen=True, eq=False)
class _Path:
    """The rows of the path, ascending; its columns, and the expected width in each row."""

    rows: Ints
    column: Ints
    expected: Floats
    width: Floats
    contrast: Singles


def thin_stripe(crop: CroppedImage, settings: ExtractSettings, sigma: float) -> ThinStripe:
    """
    Return the rows with a thin stripe and patches around it without the light under it.

    sigma : pixels, of the directly lit stripe
    """
    noise = settings.noise or SensorNoise()
    read = max(noise.read, crop.scale * crop.noise)
    ridges = find_ridges(
        crop.gray,
        crop.scale,
        crop.scale * crop.dark,
        crop.mask,
        sigma,
        replace(noise, read=min(read, 100.0)),
    )
    path = _path(ridges, sigma)
    u = path.column.astype(np.float64)
    levels = [
        level
        for sigmas in (_SIDE_SIGMAS, _OUTER_SIGMAS)
        for level in _beside(crop, path.rows, u, path.width, sigmas)
    ]
    left, right, *outer = _means(np.stack(levels), *_neighbors(path))
    distance, outer_distance = (
        2.0 * float(sigmas.mean()) * path.width for sigmas in (_SIDE_SIGMAS, _OUTER_SIGMAS)
    )
    bend = (right - left) / distance - (outer[1] - outer[0]) / outer_distance
    bulge = 0.5 * np.abs(left + right - outer[0] - outer[1])
    height = crop.scale * crop.gray[path.rows, path.column] - 0.5 * (left + right)
    dark = np.full(len(path.rows), crop.scale * crop.dark, dtype=np.float32)
    rough = Peaks(
        path.column,
        np.zeros(len(path.rows), dtype=np.float32),
        path.width.astype(np.float32),
        np.maximum(height, 1.0).astype(np.float32),
        dark,
        (height + dark).astype(np.float32),
    )
    patches = Patches.cut(crop.gray, crop.scale, path.rows, rough, settings.window, None)
    patches = _without_pedestal(patches, left, right)
    return ThinStripe(path.rows, patches, path.expected, path.contrast, bend, bulge)


def has_no_tails(
    crop: CroppedImage, stripe: ThinStripe, u: Floats, estimate: PeakEstimate
) -> Bools:
    """
    Return (n,) bool: beside which rows there is as little light as beside a Gaussian.

    u : (n,) pixels, fitted position
    """
    if not len(u):
        return np.zeros(0, dtype=bool)
    left, right = _beside(crop, stripe.rows, u, estimate.width, _TAIL_SIGMAS)
    windows = _windows(quality.segment_starts(stripe.rows, u), len(u))
    left, right, height = _means(np.stack([left, right, estimate.height]), *windows)
    beside = np.maximum(left, right) - crop.scale * crop.dark
    return np.asarray(beside < _MAX_TAIL * height)


def accepted(stripe: ThinStripe, u: Floats, width: Floats, clean: Bools) -> Bools:
    """
    Return (n,) bool: which rows belong to a long enough piece of a stripe of expected width.

    u, width : (n,) pixels, fitted position and sigma; clean : (n,) see ``has_no_tails``
    """
    rows = stripe.rows
    if not len(rows):
        return np.zeros(0, dtype=bool)
    ratio = width / stripe.expected
    first, after = _windows(quality.segment_starts(rows, u), len(rows))
    mean = _means(ratio[None], first, after)[0]
    greatest = np.where(clean, _MAX_CLEAN_WIDTH, _MAX_WIDTH)
    good = (mean > _MIN_WIDTH) & (mean < greatest)
    good &= (ratio > 0.7 * _MIN_WIDTH) & (ratio < 1.4 * greatest)
    kept = np.flatnonzero(good)
    if not len(kept):
        return np.asarray(good)
    starts = quality.segment_starts(rows[kept], u[kept])
    length = np.diff(starts)
    evidence = np.add.reduceat(stripe.contrast[kept], starts[:-1])
    short = (length < _MIN_ROWS) | (evidence < _MIN_EVIDENCE)
    place = np.arange(len(kept)) - np.repeat(starts[:-1], length)
    end = np.minimum(place, np.repeat(length, length) - 1 - place) < _END_ROWS
    good[kept[np.repeat(short, length) | end]] = False
    return np.asarray(good)


def along_stripe(
    stripe: ThinStripe, u: Floats, estimate: PeakEstimate, clean: Bools
) -> tuple[Floats, PeakEstimate]:
    """
    Return positions and estimates with less noise where a line fits the rows around.

    The sigmas contain the shift that a bend of the light under the stripe may cause.
    """
    rows, sigma = stripe.rows, estimate.sigma
    index = np.arange(len(rows))[:, None] + np.arange(-_LINE_ROWS, _LINE_ROWS + 1)
    starts = quality.segment_starts(rows, u)
    segment = np.repeat(np.arange(len(starts) - 1), np.diff(starts))[:, None]
    inside = (index >= starts[segment]) & (index < starts[segment + 1])
    index = np.clip(index, 0, len(rows) - 1)
    x = (rows[index] - rows[:, None]).astype(np.float64)
    y, weight = u[index] - u[:, None], inside / sigma[index] ** 2
    s0, s1, s2 = (np.sum(weight * x**power, axis=1) for power in range(3))
    t0, t1 = np.sum(weight * y, axis=1), np.sum(weight * x * y, axis=1)
    determinant = np.maximum(s0 * s2 - s1 * s1, 1e-12)
    shift, slope = (s2 * t0 - s1 * t1) / determinant, (s0 * t1 - s1 * t0) / determinant
    residual = y - shift[:, None] - slope[:, None] * x
    count = inside.sum(axis=1)
    chi2 = np.sum(weight * residual**2, axis=1) / np.maximum(count - 2, 1)
    used = (sigma > _NOISY * stripe.expected) & (count > _LINE_ROWS + 1) & (chi2 < _MAX_CHI2)
    averaged = np.sqrt(s2 / determinant * np.maximum(chi2, 1.0))
    total = np.where(used, averaged, sigma)
    doubt = stripe.expected * _shape_doubt(stripe, estimate, clean)
    return u + np.where(used, shift, 0.0), replace(estimate, sigma=np.hypot(total, doubt))


def _shape_doubt(stripe: ThinStripe, estimate: PeakEstimate, clean: Bools) -> Floats:
    """Return 1 sigma of the positions due to the light under the stripe, in its widths, (n,)."""
    ratio = estimate.width / stripe.expected
    parts = (
        _BEND_FACTOR * stripe.bend * stripe.expected / estimate.height,
        _BULGE_FACTOR * stripe.bulge / estimate.height,
        _WIDTH_FACTOR * np.where(clean, 0.0, np.maximum(ratio - 1.0 - _WIDTH_TOLERANCE, 0.0)),
    )
    return np.asarray(np.sqrt(sum(part**2 for part in parts)))


def _path(ridges: Ridges, sigma: float) -> _Path:
    rows = np.flatnonzero(ridges.chosen >= 0)
    place = rows, ridges.chosen[rows]
    column = ridges.column[place]
    starts = quality.segment_starts(rows, column.astype(np.float64))
    segment = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    index = np.arange(len(rows))
    first = np.maximum(index - _SLOPE_ROWS, starts[segment]) if len(rows) else index
    last = np.minimum(index + _SLOPE_ROWS, starts[segment + 1] - 1) if len(rows) else index
    slope = (column[last] - column[first]) / np.maximum(rows[last] - rows[first], 1)
    slope = np.minimum(np.abs(slope), _MAX_SLOPE)
    expected = sigma * np.hypot(1.0, slope)
    width = np.clip(ridges.width[place], expected, _MAX_CLEAN_WIDTH * expected)
    width = _means(width[None].astype(np.float64), *_windows(starts, len(rows)))[0]
    return _Path(rows, column, expected, width, ridges.contrast[place])


def _beside(
    crop: CroppedImage, rows: Ints, u: Floats, width: Floats, sigmas: Floats
) -> tuple[Floats, Floats]:
    """Return the mean gray values (0 to 255) left and right of a stripe, (n,) each."""
    away = np.maximum(width, 1.0)[:, None] * sigmas
    columns = np.rint(u[:, None] + np.concatenate([-away, away], axis=1))
    columns = np.minimum(np.maximum(columns, 0.0), crop.gray.shape[1] - 1.0)
    values = crop.gray[rows[:, None], columns.astype(np.int64)].astype(np.float64)
    # a product is faster than sums over so few values
    left, right = (values.reshape(-1, 2, len(sigmas)) @ np.ones(len(sigmas))).T / len(sigmas)
    return crop.scale * left, crop.scale * right


def _without_pedestal(patches: Patches, left: Floats, right: Floats) -> Patches:
    """Return patches less the light under the stripe, which is linear between its sides."""
    width = np.maximum(patches.rough.width, 1.0)
    middle = float(_SIDE_SIGMAS.mean()) * width
    slope = (right - left) / (2.0 * middle)
    pedestal = 0.5 * (left + right)[:, None] + slope[:, None] * patches.x
    above = np.maximum(pedestal - patches.rough.level[:, None], 0.0).astype(np.float32)
    values: Singles = np.subtract(patches.values, above, dtype=np.float32)
    return replace(patches, values=values, pedestal=above)


def _neighbors(path: _Path) -> tuple[Ints, Ints]:
    starts = quality.segment_starts(path.rows, path.column.astype(np.float64))
    return _windows(starts, len(path.rows))


def _windows(starts: Ints, count: int) -> tuple[Ints, Ints]:
    """Return for each point the first, and one past the last, of its neighbors on its segment."""
    segment = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    index = np.arange(count)
    if not count:
        return index, index
    return (
        np.maximum(index - _MEAN_ROWS, starts[segment]),
        np.minimum(index + _MEAN_ROWS + 1, starts[segment + 1]),
    )


def _means(values: Floats, first: Ints, after: Ints) -> Floats:
    """Return the means of (k, n) values from ``first`` to ``after``, (k, n)."""
    total = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=total[:, 1:])
    return np.asarray((total[:, after] - total[:, first]) / np.maximum(after - first, 1))
