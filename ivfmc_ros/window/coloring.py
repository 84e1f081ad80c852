# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Colors of points and meshes by laser, height, uncertainty, brightness or deviation.

What has a unit is colored by the scale of the reports, so that a deviation has the same color in
both.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats
from ivfmc_ros.window.drawn import BRIGHTNESS
from ivfmc_ros.window.drawn import DEVIATION
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.drawn import DrawnPoints
from ivfmc_ros.window.drawn import HEIGHT
from ivfmc_ros.window.drawn import LASER
from ivfmc_ros.window.drawn import PLAIN
from ivfmc_ros.window.drawn import SIGMA
from ivfmc_ros.window.drawn import TEXTURE
from ivfmc_ros.window.placed_nominal import deviation_bar
from ivfmc_ros.window.placed_nominal import PlacedNominal

# Colors of up to four lasers that color-blind people can tell apart (Okabe and Ito 2008).
_LASERS = np.array([(213, 94, 0), (0, 114, 178), (0, 158, 115), (204, 121, 167)], dtype=np.uint8)
_GRAY = (176, 182, 190)
# Percentiles between which a scale of colors spans, so that few outliers do not stretch it.
_SPAN = (2.0, 98.0)
# Scales of points, meters; fixed, because a batch of profiles must not have one of its own.
_POINT_BARS = {
    HEIGHT: ColorBar(low=0.0, high=0.1, quantity=HEIGHT),
    SIGMA: ColorBar(low=0.0, high=1e-4, quantity=SIGMA),
}


def point_bar(mode: str, nominal: PlacedNominal | None) -> ColorBar | None:
    """Return the scale of a mode of points; None for one without."""
    if mode == DEVIATION:
        return None if nominal is None else nominal.bar
    return _POINT_BARS.get(mode)


def color_points(points: DrawnPoints, mode: str, nominal: PlacedNominal | None) -> Bytes:
    """Return (n, 3) RGB of n points; those of a deviation are gray without a nominal."""
    bar = point_bar(mode, nominal)
    if mode == LASER:
        return by_laser(points.laser)
    if mode == BRIGHTNESS:
        return by_gray(points.intensity)
    if bar is None:
        return plain(len(points.points_xyz))
    if mode == DEVIATION and nominal is not None:
        return _colors(nominal.deviations(points.points_xyz), bar)
    return _colors(points.points_xyz[:, 2] if mode == HEIGHT else points.sigma, bar)


def color_mesh(mesh: DrawnMesh, mode: str) -> tuple[Bytes, ColorBar | None]:
    """Return (n, 3) RGB of the vertices of a mesh, and the scale; None for a mode without one."""
    if mode == PLAIN:
        return plain(len(mesh.vertices_xyz)), None
    if mode == TEXTURE:
        return by_gray(mesh.values[mode]), None
    values = mesh.vertices_xyz[:, 2] if mode == HEIGHT else mesh.values[mode]
    if mode == DEVIATION and mesh.tolerance is not None:
        bar = deviation_bar(mesh.tolerance)
    else:
        low, high = span_of(values, symmetric=mode == DEVIATION)
        bar = ColorBar(low=low, high=high, quantity=mode)
    return _colors(values, bar), bar


def by_laser(lasers: NDArray[Any]) -> Bytes:
    """Return (n, 3) RGB for (n,) indices of lasers."""
    return np.asarray(_LASERS[np.asarray(lasers, dtype=int) % len(_LASERS)])


def plain(count: int) -> Bytes:
    """Return (n, 3) RGB of one gray."""
    return np.tile(np.array(_GRAY, dtype=np.uint8), (count, 1))


def by_gray(values: Floats) -> Bytes:
    """Return (n, 3) RGB of (n,) gray values from 0 to 255; NaN is black."""
    gray = np.nan_to_num(values).clip(0.0, 255.0).astype(np.uint8)
    return np.repeat(gray[:, None], 3, axis=1)


def linear(colors: Bytes) -> Bytes:
    """Return (n, 4) linear RGBA, which glTF demands, of (n, 3) sRGB (IEC 61966-2-1)."""
    share = colors / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    opaque = np.ones((len(colors), 1))
    return np.asarray(np.hstack([light, opaque]) * 255.0 + 0.5).astype(np.uint8)


def span_of(values: Floats, symmetric: bool = False) -> tuple[float, float]:
    """Return the limits of a scale for (n,) values, NaN ignored; about 0 if ``symmetric``."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 1.0
    if symmetric:
        high = float(np.percentile(np.abs(known), _SPAN[1]))
        return -high, high
    low, high = (float(value) for value in np.percentile(known, _SPAN))
    return low, max(high, low + 1e-12)


def bar_html(bar: ColorBar | None) -> str:
    """Return the scale of colors as HTML that fits the page; '' without one."""
    if bar is None:
        return ''
    svg = bar.svg().replace('<svg ', '<svg style="width:100%;height:auto" ', 1)
    return f'<div style="padding:0 0.6em">{svg}</div>'


def _colors(values: Floats, bar: ColorBar) -> Bytes:
    return np.asarray(bar.colors(values)[:, ::-1])
