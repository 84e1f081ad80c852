# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawings of a report as SVG: labeled views, histogram; text stays text, also when printed."""

import base64
from collections.abc import Mapping
from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.callouts import Callout
from ivfmc_ros.inspection.reports.callouts import LABEL_HEIGHT
from ivfmc_ros.inspection.reports.callouts import LABEL_WIDTH
from ivfmc_ros.inspection.reports.callouts import MARGIN
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.feature_views import LabeledView
from ivfmc_ros.inspection.reports.feature_views import SIZE
from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.model import Floats

_INK = '#1c2530'
_FILLS = {PASS: '#0b5d1e', FAIL: '#8f1010'}
_UNDECIDED_FILL = '#7a5600'
_BINS = 60
_JPEG_QUALITY = 85


def view_figure(view: LabeledView, names: Sequence[str], verdicts: Mapping[str, str]) -> str:
    """
    Return a labeled view as the HTML of a figure.

    names : of the regions by number, from 1
    verdicts : by name of the region; the color of its label
    """
    width, height = SIZE[0] + 2 * MARGIN, SIZE[1] + 26
    labels = ''.join(
        _callout(callout, names[callout.number - 1], verdicts.get(names[callout.number - 1], ''))
        for callout in view.callouts
    )
    azimuth, elevation = view.direction
    caption = (
        f'parallel projection, seen from azimuth {azimuth % 360}°, elevation {elevation}° '
        'of the nominal'
    )
    if view.unnamed:
        caption += f'; no room for the numbers of {view.unnamed} more'
    return (
        f'<figure><svg class="labeled" viewBox="0 0 {width:.0f} {height}" '
        f'width="{width:.0f}" font-size="12" role="img" aria-label="{caption}">'
        f'<image x="{MARGIN}" y="0" width="{SIZE[0]}" height="{SIZE[1]}" '
        f'href="data:image/jpeg;base64,{_jpeg(view.picture)}"/>{_bar(view.bar)}{labels}</svg>'
        f'<figcaption>{caption}</figcaption></figure>'
    )


def _callout(callout: Callout, name: str, verdict: str) -> str:
    (x1, y1), (x2, y2) = callout.leader
    x, y = callout.center
    fill = _FILLS.get(verdict, _UNDECIDED_FILL)
    title = escape(f'{name}: {verdict}' if verdict else name)
    return (
        f'<g class="callout"><title>{title}</title>'
        # a white line below the dark one keeps it visible on dark colors
        f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="#fff" stroke-width="3"/>'
        f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{_INK}"/>'
        f'<circle cx="{x2:.1f}" cy="{y2:.1f}" r="3" fill="{_INK}" stroke="#fff"/>'
        f'<rect x="{x - LABEL_WIDTH / 2:.1f}" y="{y - LABEL_HEIGHT / 2:.1f}" rx="4" '
        f'width="{LABEL_WIDTH:.0f}" height="{LABEL_HEIGHT:.0f}" fill="{fill}"/>'
        f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" fill="#fff" '
        f'font-weight="600">{callout.number}</text></g>'
    )


def _bar(bar: tuple[float, float]) -> str:
    length, pixels = bar
    # below the picture, where it hides nothing
    x, y = MARGIN + 8.0, SIZE[1] + 22.0
    return (
        f'<path d="M{x:.1f} {y - 5:.1f}v5h{pixels:.1f}v-5" fill="none" stroke="{_INK}" '
        f'stroke-width="2"/><text x="{x + pixels / 2:.1f}" y="{y - 6:.1f}" '
        f'text-anchor="middle">{length * 1e3:g} mm</text>'
    )


def _jpeg(picture: ColorImage) -> str:
    _, encoded = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return base64.b64encode(encoded.tobytes()).decode('ascii')


def histogram(values: Floats, bar: ColorBar) -> str:
    """
    Draw how many of (n,) values, meters, lie where on a scale.

    What lies beyond an end of the scale is counted in its last bar.
    """
    counts, _ = np.histogram(np.clip(values, bar.low, bar.high), _BINS, (bar.low, bar.high))
    width, height = 720.0, 140.0
    top = max(int(counts.max(initial=0)), 1)
    step = (bar.high - bar.low) / _BINS
    middles = np.asarray(bar.low + (np.arange(_BINS) + 0.5) * step, dtype=np.float64)
    colors = bar.colors(middles).tolist()
    bars = ''.join(
        f'<rect x="{k * width / _BINS:.1f}" y="{18 + height - height * n / top:.1f}" '
        f'width="{width / _BINS - 1:.1f}" height="{height * n / top:.1f}" '
        f'fill="#{r:02x}{g:02x}{b:02x}"/>'
        for k, (n, (b, g, r)) in enumerate(zip(counts.tolist(), colors, strict=True))
    )
    share = 100.0 * top / max(len(values), 1)
    labels = ''.join(
        f'<text x="{place * width:.0f}" y="{height + 34:.0f}" text-anchor="{anchor}">'
        f'{1e3 * (bar.low + place * (bar.high - bar.low)):.3g} mm</text>'
        for place, anchor in ((0.0, 'start'), (0.5, 'middle'), (1.0, 'end'))
    )
    return (
        f'<svg class="histogram" viewBox="0 0 {width:.0f} {height + 40:.0f}" '
        f'width="{width:.0f}" font-size="12" role="img" aria-label="distribution of '
        f'{escape(bar.quantity)}">{bars}<path d="M0 {18 + height}H{width}" stroke="{_INK}"/>'
        f'{_limits(bar, width, height)}{labels}<text x="0" y="12">highest bar: {share:.3g} % of '
        f'{len(values):,} vertices; a bar is {step * 1e3:.2g} mm wide</text></svg>'
    )


def _limits(bar: ColorBar, width: float, height: float) -> str:
    if bar.tolerance is None:
        return ''
    return ''.join(
        f'<path d="M{width * (limit - bar.low) / (bar.high - bar.low):.1f} 18v{height}" '
        f'stroke="{_INK}" stroke-dasharray="5 3"><title>tolerance</title></path>'
        for limit in (-bar.tolerance, bar.tolerance)
    )
