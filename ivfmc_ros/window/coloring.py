# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of points and meshes by laser, height, uncertainty, brightness or deviation."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.model import Bytes
from ivfmc_ros.model import Floats

LASER, HEIGHT, SIGMA, BRIGHTNESS, DEVIATION, TEXTURE, PLAIN = (
    'laser',
    'height',
    'uncertainty',
    'brightness',
    'deviation',
    'texture',
    'plain',
)
POINT_MODES = (LASER, HEIGHT, SIGMA, BRIGHTNESS)
# Colors of up to four lasers that color-blind people can tell apart (Okabe and Ito 2008).
_LASERS = np.array([(213, 94, 0), (0, 114, 178), (0, 158, 115), (204, 121, 167)], dtype=np.uint8)
_GRAY = (176, 182, 190)
# Percentiles between which a scale of colors spans, so that few outliers do not stretch it.
_SPAN = (2.0, 98.0)


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


def by_value(values: Floats, low: float, high: float, diverging: bool = False) -> Bytes:
    """
    Return (n, 3) RGB for (n,) values on a scale; gray where a value is NaN.

    diverging : blue below, white at, red above the middle of the scale
    """
    share = np.clip((values - low) / max(high - low, 1e-30), 0.0, 1.0)
    index = np.nan_to_num(share * 255.0).astype(np.uint8)
    table = _diverging() if diverging else _viridis()
    colors = table[index]
    colors[~np.isfinite(values)] = _GRAY
    return np.asarray(colors, dtype=np.uint8)


def _viridis() -> Bytes:
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    colors: Any = cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS)
    return np.asarray(colors[:, 0, ::-1], dtype=np.uint8).copy()


def _diverging() -> Bytes:
    t = np.linspace(-1.0, 1.0, 256)
    white = 1.0 - np.abs(t)
    low = np.array([33.0, 102.0, 172.0])
    high = np.array([178.0, 24.0, 43.0])
    end = np.where(t[:, None] < 0.0, low, high)
    return np.asarray(white[:, None] * 245.0 + (1.0 - white[:, None]) * end, dtype=np.uint8)
