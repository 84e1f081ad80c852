# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Section cuts as SVG: nominal, tolerance band, measured contour with larger deviations."""

from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.inspection.reports.feature_views import SIZE
from ivfmc_ros.inspection.reports.rendering import scale_bar
from ivfmc_ros.inspection.section_cut import IN_PLANE
from ivfmc_ros.inspection.section_cut import SectionCut
from ivfmc_ros.inspection.section_plane import AXES
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_INK, _BAND, _NOMINAL = '#1c2530', '#d5ead7', '#5a6675'
_WITHIN, _OUTSIDE, _NOT_JUDGED = '#1f5fa8', '#c22020', '#8fb0d4'
# Pixels: around the contours, and below them for the bars.
_MARGIN, _FOOT = 26.0, 40.0
# Half the width of the tolerance band in the drawing, pixels: a deviation of a tenth of the
# tolerance is then still seen.
_BAND_PIXELS = 9.0
# A larger deviation, in tolerances, is drawn as this one, or it hides the shape of the part.
_MAX_DRAWN = 3.0
_LETTER = 8.0  # pixels, width of a bold letter
_SEEN_FROM = {'x': '+x', 'y': '-y', 'z': '+z'}


@dataclass(frozen=True, eq=False)
class _Sheet:
    """
    The drawing: pixels from coordinates in the plane, and what a deviation is multiplied by.

    low : (2,) meters, of the contours; scale : pixels per meter
    """

    low: Floats
    scale: float
    height: float
    exaggeration: float

    def pixels(self, points: Floats) -> Floats:
        """Return (..., 2) pixels, y downwards."""
        xy = (points - self.low) * self.scale + _MARGIN
        return np.stack([xy[..., 0], self.height - xy[..., 1]], axis=-1)


def section_figure(cut: SectionCut, tolerance: float) -> str:
    """
    Return a section as the HTML of a figure.

    tolerance : meters, to either side of the nominal
    """
    sheet = _sheet(cut, tolerance)
    width, height = float(SIZE[0]), sheet.height + _FOOT
    caption = _caption(cut, tolerance, sheet.exaggeration)
    return (
        f'<figure class="section"><svg class="labeled" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" font-size="12" role="img" aria-label="section {cut.name}">'
        f'{_contours(cut, sheet, tolerance)}{_worst(cut, sheet, tolerance)}'
        f'{_axes(cut, sheet)}{_bars(sheet, tolerance)}</svg>'
        f'<figcaption>{caption}</figcaption></figure>'
    )


def _sheet(cut: SectionCut, tolerance: float) -> _Sheet:
    points = np.concatenate([cut.nominal, cut.measured]).reshape(-1, 2)
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-6)
    free = np.array(SIZE) - 2 * _MARGIN
    scale = float((free / size).min())
    return _Sheet(
        low=low - np.array([0.5 * (free[0] / scale - size[0]), 0.0]),
        scale=scale,
        height=float(size[1] * scale) + 2 * _MARGIN,
        exaggeration=_rounded(_BAND_PIXELS / (tolerance * scale)),
    )


def _rounded(factor: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... that is not greater, at least 1."""
    if factor <= 1.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(factor))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= factor * 1.0001)


def _contours(cut: SectionCut, sheet: _Sheet, tolerance: float) -> str:
    band = 2.0 * tolerance * sheet.exaggeration * sheet.scale
    nominal = _path(sheet.pixels(cut.nominal))
    shown = sheet.pixels(_exaggerated(cut, sheet, tolerance))
    outside = cut.judged & (np.abs(cut.deviations) > tolerance).any(axis=1)
    return (
        f'<path d="{nominal}" stroke="{_BAND}" stroke-width="{band:.1f}" stroke-linecap="round"/>'
        f'<path d="{nominal}" stroke="{_NOMINAL}"/>'
        + _line(shown, cut.filled, f'stroke="{_NOMINAL}" stroke-width="0.7"')
        + _line(shown, ~cut.judged & ~cut.filled, f'stroke="{_NOT_JUDGED}" stroke-width="1.2"')
        + _line(shown, cut.judged & ~outside, f'stroke="{_WITHIN}" stroke-width="1.6"')
        + _line(shown, outside, f'stroke="{_OUTSIDE}" stroke-width="2"')
    )


def _exaggerated(cut: SectionCut, sheet: _Sheet, tolerance: float) -> Floats:
    """Return the (m, 2, 2) measured contour, meters, as it is drawn."""
    limit = _MAX_DRAWN * tolerance
    drawn = sheet.exaggeration * np.clip(cut.deviations, -limit, limit)
    return np.asarray(cut.measured + (drawn - cut.deviations)[..., None] * cut.normals)


def _line(segments: Floats, chosen: Bools, style: str) -> str:
    if not chosen.any():
        return ''
    return f'<path d="{_path(segments[chosen])}" {style} stroke-linecap="round"/>'


def _path(segments: Floats) -> str:
    # a fine mesh has many segments that are shorter than can be seen
    rounded = np.round(segments, 1)
    segments = rounded[(rounded[:, 0] != rounded[:, 1]).any(axis=1)]
    return ''.join(f'M{x1:g} {y1:g}L{x2:g} {y2:g}' for (x1, y1), (x2, y2) in segments.tolist())


def _worst(cut: SectionCut, sheet: _Sheet, tolerance: float) -> str:
    if not math.isfinite(cut.worst):
        return ''
    drawn = _exaggerated(cut, sheet, tolerance).reshape(-1, 2)[cut.worst_end]
    x, y = sheet.pixels(drawn).tolist()
    # towards the middle of the drawing, where the label has room
    side = 1.0 if x < SIZE[0] / 2 else -1.0
    tip, anchor = x + 16.0 * side, 'start' if side > 0 else 'end'
    text = f'{cut.worst * 1e3:+.3f} mm'
    wide = _LETTER * len(text) + 6.0
    left = min(tip, tip + wide * side)
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="none" stroke="{_INK}"/>'
        f'<path d="M{x + 4 * side:.1f} {y:.1f}H{tip:.1f}" stroke="{_INK}"/>'
        f'<rect x="{left:.1f}" y="{y - 8:.1f}" width="{wide:.1f}" height="16" '
        'fill="#fff" fill-opacity="0.8"/>'
        f'<text x="{tip + 3 * side:.1f}" y="{y + 4:.1f}" text-anchor="{anchor}" font-weight="600">'
        f'{text}</text>'
    )


def _axes(cut: SectionCut, sheet: _Sheet) -> str:
    """Return the names of the axes with their directions; drawn, as few fonts have arrows."""
    right, up = (AXES[column] for column in IN_PLANE[cut.axis])
    x, y = SIZE[0] - 8.0, sheet.height - 8.0
    return (
        f'<text x="{x - 20:.0f}" y="{y + 4:.0f}" text-anchor="end">{right}</text>'
        f'<path d="M{x - 16:.0f} {y:.0f}h14m-5 -4l5 4l-5 4" fill="none" stroke="{_INK}"/>'
        f'<text x="4" y="14">{up}</text>'
        f'<path d="M18 17v-14m-4 5l4 -5l4 5" fill="none" stroke="{_INK}"/>'
    )


def _bars(sheet: _Sheet, tolerance: float) -> str:
    """Return the bar of lengths, and the one of deviations as wide as the tolerance band."""
    length, pixels = scale_bar(sheet.scale, SIZE[0])
    band = 2.0 * tolerance * sheet.exaggeration * sheet.scale
    y, x = sheet.height + 30.0, SIZE[0] - 130.0
    return (
        f'<path d="M8 {y - 5:.1f}v5h{pixels:.1f}v-5" fill="none" stroke="{_INK}" '
        f'stroke-width="2"/><text x="8" y="{y - 9:.1f}">{length * 1e3:g} mm</text>'
        f'<rect x="{x:.1f}" y="{y - band / 2 - 4:.1f}" width="14" height="{band:.1f}" '
        f'fill="{_BAND}"/><path d="M{x:.1f} {y - 4:.1f}h14" stroke="{_NOMINAL}"/>'
        f'<text x="{x + 20:.1f}" y="{y:.1f}">±{tolerance * 1e3:g} mm</text>'
    )


def _caption(cut: SectionCut, tolerance: float, exaggeration: float) -> str:
    text = (
        f'section {cut.name} of the nominal, seen from {_SEEN_FROM[cut.axis]}; measured contour '
        f'with deviations {exaggeration:g} times as large, band ±{tolerance * 1e3:g} mm'
    )
    if not math.isfinite(cut.worst):
        return f'{text}; nothing was measured here away from edges'
    if abs(cut.worst) > _MAX_DRAWN * tolerance:
        text += f' (drawn up to {_MAX_DRAWN * tolerance * 1e3:g} mm)'
    known = math.isfinite(cut.worst_u)
    sure = f'U = {cut.worst_u * 1e3:.3f} mm (k = 2)' if known else 'U not known'
    return (
        f'{text}. Worst {cut.worst * 1e3:+.3f} mm, {sure}; rms {cut.rms * 1e3:.3f} mm. Red: '
        'outside the band; pale: at an edge, not judged; thin gray: only closes the mesh'
    )
