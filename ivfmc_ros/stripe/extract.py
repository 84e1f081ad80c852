# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the stripe is: one sub-pixel position in every row of a picture that shows it.

The peak of the smoothed row is found first. The stripe's width is measured at half its height,
and a centre of mass is taken in a window that is scaled to this width and moved until it is
centred on its own result, so that the window cannot pull the answer to a pixel's centre.
"""

from dataclasses import dataclass
from dataclasses import field
from typing import cast

import cv2
import numpy as np
from scipy.special import ndtr

from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.noise import Noise

_FWHM_PER_SIGMA = 2.0 * np.sqrt(2.0 * np.log(2.0))
_RECENTRINGS = 3


@dataclass(frozen=True, kw_only=True)
class ExtractSettings:
    """
    How the stripe is found.

    channel : auto (what does not saturate in the picture), or colours such as blue+red
    min_contrast : least height of the stripe above its background, share of full scale
    window : half the window of the centre of mass, in sigmas of the stripe
    max_sigma : a stripe wider than this (sigma, pixels) is no stripe
    smoothing : width in pixels of the box that finds the peak; odd
    """

    channel: str = 'auto'
    min_contrast: float = 0.06
    window: float = 2.2
    max_sigma: float = 12.0
    smoothing: int = 5
    noise: Noise = field(default_factory=Noise)

    def __post_init__(self) -> None:
        if self.channel != 'auto':
            channel.weights_of(self.channel)
        _require('min_contrast', self.min_contrast, 0.0 < self.min_contrast < 1.0, '0 to 1')
        _require('window', self.window, 1.0 <= self.window <= 5.0, '1 to 5')
        _require('max_sigma', self.max_sigma, 1.0 <= self.max_sigma <= 50.0, '1 to 50 pixels')
        odd = self.smoothing % 2 == 1 and 1 <= self.smoothing <= 31
        _require('smoothing', self.smoothing, odd, 'odd, 1 to 31')


def _require(name: str, value: float, fits: bool, allowed: str) -> None:
    if not fits:
        raise ParameterError(f'{name}: {value} is out of range; it must be {allowed}')


@dataclass(frozen=True, eq=False, kw_only=True)
class Stripe:
    """
    The stripe of one picture, one entry for each row (or column) where it was found.

    uv : (n, 2) float64, pixel (column, row)
    intensity : (n,) float64, height above the background in grey values of 0 to 255
    width : (n,) float64, sigma of the stripe in pixels
    sigma : (n,) float64, 1 sigma of the position in pixels, from the noise of the pixels
    """

    uv: Floats
    intensity: Floats
    width: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, chosen: Bools) -> 'Stripe':
        return Stripe(
            uv=self.uv[chosen],
            intensity=self.intensity[chosen],
            width=self.width[chosen],
            sigma=self.sigma[chosen],
        )


def extract(
    image: Image,
    stripe: Direction = 'rows',
    settings: ExtractSettings | None = None,
    mask: Bools | None = None,
) -> Stripe:
    """
    Find the stripe in a picture.

    image : (h, w) mono or (h, w, 3) BGR, uint8 or uint16
    stripe : 'rows' for one point in every row, 'columns' for one in every column
    mask : (h, w) bool, where the stripe can be; None for everywhere
    returns : without rows that have no stripe, or one that the picture's border cuts
    """
    settings = settings or ExtractSettings()
    if stripe == 'columns':
        image = cast(Image, cv2.transpose(image))
        mask = None if mask is None else np.ascontiguousarray(mask.T)
    grey = channel.to_grey(image, settings.channel)
    scale = 255.0 / np.iinfo(grey.dtype).max
    rows, peaks = _find_peaks(grey, settings, mask)
    found = _measure(_Patches.cut(grey, rows, peaks, settings, scale), rows, settings)
    found = found[_is_whole(found, grey.shape[1], settings)]
    return _swapped(found) if stripe == 'columns' else found


def _is_whole(stripe: Stripe, width: int, settings: ExtractSettings) -> Bools:
    """Tell where the whole window is on the picture: a cut stripe is measured off its centre."""
    half = settings.window * stripe.width
    u = stripe.uv[:, 0]
    return np.asarray((u - half >= -0.5) & (u + half <= width - 0.5))


def _swapped(stripe: Stripe) -> Stripe:
    return Stripe(
        uv=np.ascontiguousarray(stripe.uv[:, ::-1]),
        intensity=stripe.intensity,
        width=stripe.width,
        sigma=stripe.sigma,
    )


def _find_peaks(grey: Image, settings: ExtractSettings, mask: Bools | None) -> tuple[Ints, Ints]:
    """Return the rows, and in each the column of the smoothed peak, that stand out at all."""
    smooth = cv2.blur(grey, (settings.smoothing, 1), borderType=cv2.BORDER_REPLICATE)
    if mask is not None:
        smooth = smooth * mask
    peaks = smooth.argmax(axis=1)
    rows = np.arange(len(grey))
    height = smooth[rows, peaks]
    lit = height > 0.5 * settings.min_contrast * np.iinfo(grey.dtype).max
    return rows[lit], peaks[lit]


@dataclass(frozen=True, eq=False)
class _Patches:
    """
    The surroundings of each peak, in grey values of 0 to 255.

    x : (n, w) column of each pixel; values : (n, w); inside : (n, w) bool, on the picture
    """

    x: Ints
    values: Floats
    inside: Bools

    @classmethod
    def cut(
        cls, grey: Image, rows: Ints, peaks: Ints, settings: ExtractSettings, scale: float
    ) -> '_Patches':
        reach = int(np.ceil(3.0 * settings.max_sigma))
        x = peaks[:, None] + np.arange(-reach, reach + 1)
        inside = (x >= 0) & (x < grey.shape[1])
        # beyond the picture's border its last pixel repeats, which keeps the background right
        values = grey[rows[:, None], np.clip(x, 0, grey.shape[1] - 1)] * scale
        return cls(x, values, inside)


def _measure(patches: _Patches, rows: Ints, settings: ExtractSettings) -> Stripe:
    background = _background(patches)
    signal = np.where(patches.inside, patches.values - background[:, None], 0.0)
    height = _peak_height(signal, settings)
    left, right = _half_height(signal, height)
    width = (right - left) / _FWHM_PER_SIGMA
    good = (height >= settings.min_contrast * 255.0) & (width <= settings.max_sigma)
    good &= np.isfinite(width)
    signal, x = signal[good], patches.x[good].astype(np.float64)
    width = np.maximum(width[good], 0.5)
    middle = 0.5 * (left + right)[good] + x[:, 0]
    u, sigma = _centre_of_mass(x, signal, background[good], middle, width, settings)
    found = Stripe(
        uv=np.stack([u, rows[good].astype(np.float64)], axis=1),
        intensity=height[good],
        width=width,
        sigma=sigma,
    )
    return found[np.isfinite(sigma) & (np.abs(u - middle) <= width)]


def _background(patches: _Patches) -> Floats:
    """Return the level of the darker side of each stripe: the other may be lit by the stripe."""
    reach = patches.values.shape[1] // 2
    dark = int(0.3 * reach)
    sides = (patches.values[:, :reach], patches.values[:, reach + 1 :])
    levels = [np.partition(side, dark, axis=1)[:, dark] for side in sides]
    return np.minimum(*levels)


def _peak_height(signal: Floats, settings: ExtractSettings) -> Floats:
    """Return the height of each peak, averaged over three pixels against noise."""
    reach = signal.shape[1] // 2
    near = slice(reach - settings.smoothing, reach + settings.smoothing + 1)
    smooth = (signal[:, :-2] + signal[:, 1:-1] + signal[:, 2:]) / 3.0
    return np.asarray(smooth[:, near].max(axis=1))


def _half_height(signal: Floats, height: Floats) -> tuple[Floats, Floats]:
    """Return where each stripe falls below half its height, left and right, as patch columns."""
    reach = signal.shape[1] // 2
    half = 0.5 * height
    right = reach + _first_below(signal[:, reach:], half)
    left = reach - _first_below(signal[:, reach::-1], half)
    return left, right


def _first_below(values: Floats, level: Floats) -> Floats:
    """Return the interpolated column where values first fall below level; NaN if never."""
    below = values < level[:, None]
    # the peak itself may be a dark grain of speckle: the fall counts from its neighbour
    below[:, 0] = False
    index = below.argmax(axis=1)
    rows = np.arange(len(values))
    after, before = values[rows, index], values[rows, np.maximum(index - 1, 0)]
    with np.errstate(divide='ignore', invalid='ignore'):
        share = np.clip((before - level) / (before - after), 0.0, 1.0)
    return np.where(index > 0, index - 1 + share, np.nan)


def _centre_of_mass(
    x: Floats,
    signal: Floats,
    background: Floats,
    middle: Floats,
    width: Floats,
    settings: ExtractSettings,
) -> tuple[Floats, Floats]:
    """Return the centre of mass of each stripe and its 1 sigma, (n,) pixels."""
    half = (settings.window * width)[:, None]
    centre = middle[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        for _ in range(_RECENTRINGS):
            # pixels on the window's rim count in part, or the result would lock to whole pixels
            weight = np.clip(half - np.abs(x - centre) + 0.5, 0.0, 1.0)
            mass = weight * signal
            total = mass.sum(axis=1, keepdims=True)
            centre = (mass * x).sum(axis=1, keepdims=True) / total
        variance = settings.noise.variance(signal + background[:, None], signal)
        spread = (weight * (x - centre)) ** 2 * variance
        sigma = np.sqrt(spread.sum(axis=1)) / total[:, 0] / _follow(settings.window)
    return centre[:, 0], np.where(total[:, 0] > 0, sigma, np.nan)


def _follow(window: float) -> float:
    """Return which share of an offset of the window its centre of mass takes back."""
    density = np.exp(-0.5 * window**2) / np.sqrt(2.0 * np.pi)
    inside = 1.0 - 2.0 * ndtr(-window)
    return float(1.0 - 2.0 * window * density / inside)
