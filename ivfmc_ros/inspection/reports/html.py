# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of ``report.html``, a self-contained page with a WebGL view of the mesh."""

import base64
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from html import escape
import json
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.inspection.reports import tables
from ivfmc_ros.inspection.reports import viewer
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.drawings import histogram
from ivfmc_ros.meshing.filters.vertex_clustering import cluster_vertices_with_values
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Triangles of the embedded mesh at most; the file then has about 3 MB.
MOST_TRIANGLES = 150_000
_NO_VALUE = 255
# Parts of the figures that a reader wants first; the others are folded.
_UNFOLDED = ('characteristics', 'surface', 'sections', 'views', 'completeness')


@dataclass(frozen=True, kw_only=True)
class ReportImage:
    """
    An image of a report.

    data : encoded; media : its type, such as image/jpeg
    bar : what its colors mean; None where they mean nothing
    """

    data: bytes
    media: str
    caption: str
    bar: ColorBar | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Page:
    """
    What a report shows.

    vertices_xyz : (n, 3) meters; faces : (m, 3); values : (n,) meters, NaN where there is none
    span : meters, where the colors end; they begin at -span, or at 0 if not ``signed``
    figures : numbers by name, in SI units, as ``tables`` shows them
    heading : what was measured, when and how: the block of texts below the title
    still : picture of the mesh for a printed page, in which nothing turns; None for none
    drawings : HTML of figures that are shown first
    sections : HTML of figures of section cuts
    tolerance : meters to either side of zero, marked at the colors; None for none
    """

    title: str
    vertices_xyz: Floats
    faces: Ints
    values: Floats
    span: float
    figures: Mapping[str, Any]
    signed: bool = True
    quantity: str = 'deviation'
    pictures: Sequence[ReportImage] = ()
    heading: Mapping[str, str] = field(default_factory=dict)
    still: ReportImage | None = None
    drawings: Sequence[str] = ()
    sections: Sequence[str] = ()
    tolerance: float | None = None

    @property
    def bar(self) -> ColorBar:
        """The scale of the colors."""
        low = -self.span if self.signed else 0.0
        return ColorBar(low=low, high=self.span, quantity=self.quantity, tolerance=self.tolerance)


def write_html(path: Path, page: Page) -> None:
    """
    Write a report with a mesh that can be turned.

    :raises FileError: the file cannot be written
    """
    title = escape(tables.without_folders(page.title))
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        # without this a browser asks for one
        f'<link rel="icon" href="data:,"><title>{title}</title><style>{viewer.STYLE}</style>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'</head><body>{_verdict(page.figures)}<h1>{title}</h1>',
        _heading(page.heading),
        _row(page.drawings),
        _figure(page.still, 'print'),
        '<div class="screen"><canvas id="view"></canvas><p><span id="state">drawing</span> &nbsp; '
        '<label><input type="checkbox" id="plain"> plain</label></p></div>',
        page.bar.svg(),
        f'<h2>Distribution of {escape(page.quantity)}</h2>',
        histogram(page.values[np.isfinite(page.values)], page.bar),
        f'<h2>Sections</h2>{_row(page.sections)}' if page.sections else '',
        tables.folded(page.figures, _UNFOLDED),
        _gallery(page.pictures),
        f'<script type="application/json" id="mesh">{_mesh(page)}</script>',
        f'<script>{viewer.PROGRAM}</script></body></html>',
    ]
    files.write_text(path, '\n'.join(parts))


def _mesh(page: Page) -> str:
    vertices, faces, values = cluster_vertices_with_values(
        page.vertices_xyz, page.faces, page.values, MOST_TRIANGLES
    )
    low, high = page.bar.low, page.bar.high
    start, size = vertices.min(axis=0), np.maximum(np.ptp(vertices, axis=0), 1e-9)
    places = np.round((vertices - start) / size * 65535).astype('<u2')
    with np.errstate(invalid='ignore'):
        shades = np.clip((values - low) / (high - low), 0.0, 1.0) * 254.0
    bytes_ = np.where(np.isfinite(values), np.nan_to_num(shades), _NO_VALUE).astype(np.uint8)
    return json.dumps(
        {
            'size': (size * 1e3).tolist(),
            'places': _encoded(places.tobytes()),
            'values': _encoded(bytes_.tobytes()),
            'corners': _encoded(faces.astype('<u4').tobytes()),
        }
    )


def _encoded(data: bytes) -> str:
    return base64.b64encode(data).decode('ascii')


def _verdict(figures: Mapping[str, Any]) -> str:
    """Return the verdict, or the code of a scan that is not OK, as the first thing of the page."""
    inspection = figures.get('inspection')
    nested = inspection.get('verdict') if isinstance(inspection, Mapping) else None
    text = str(figures.get('verdict') or nested or '')
    code = str(figures.get('code') or 'OK')
    if code != 'OK':
        text, kind = code, 'fail'
    else:
        kind = text.split(maxsplit=1)[0] if text else ''
    return f'<p class="banner {escape(kind)}">{escape(text.upper())}</p>' if text else ''


def _heading(texts: Mapping[str, str]) -> str:
    items = ''.join(
        f'<div><dt>{escape(name)}</dt>'
        # what is left blank is filled in on paper
        f'{f"<dd>{escape(text)}</dd>" if text else "<dd class=blank>&nbsp;</dd>"}</div>'
        for name, text in zip(texts, map(tables.without_folders, texts.values()), strict=True)
    )
    return f'<dl class="heading">{items}</dl>' if items else ''


def _row(figures: Sequence[str]) -> str:
    return f'<div class="row">{"".join(figures)}</div>' if figures else ''


def _figure(picture: ReportImage | None, kind: str = '') -> str:
    if picture is None:
        return ''
    caption = escape(picture.caption)
    return (
        f'<figure{kind and f" class={kind}"}><img alt="{caption}" '
        f'src="data:{picture.media};base64,{_encoded(picture.data)}">'
        f'{picture.bar.svg() if picture.bar else ""}<figcaption>{caption}</figcaption></figure>'
    )


def _gallery(pictures: Sequence[ReportImage]) -> str:
    shown = _row([_figure(picture) for picture in pictures])
    return f'<h2>Pictures</h2>{shown}' if shown else ''
