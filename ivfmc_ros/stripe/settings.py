# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the stripe is found."""

from dataclasses import dataclass

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.noise import Noise


@dataclass(frozen=True, kw_only=True)
class ExtractSettings:
    """
    How the stripe is found.

    method : how its place is estimated, one of ``METHODS``; auto: gaussian, or top_of_peak where
        the first pictures of a scan show that the material glows
    channel : auto (what does not saturate in the picture), or colours such as blue+red
    min_snr : least height of the stripe, in standard deviations of its own estimate
    min_contrast : least height of the stripe above its background, share of full scale
    max_error : pixels; a point whose noise gives it a larger sigma is dropped (not by the method
        paper, which is nowhere that sure)
    max_doubt : so is one whose sigma, with ``doubt``, is a larger share of the stripe's width
    window : half the window of the estimate, in sigmas of the stripe
    max_sigma : a stripe wider than this (sigma, pixels) is no stripe
    max_widening : nor one that is so many times as wide as the picture's median
    smoothing : width in pixels of the box that finds the peak; odd
    path : search one path along the stripe where rows have several peaks
    doubt : let sigma grow where the profile is not a stripe's
    least_width : sigma in pixels below which an edge has cut the stripe; None: told by the first
        pictures of a scan, and nothing in a single one
    along : rows (sigma of a Gaussian) over which places are smoothed along the stripe; 0 for none
    noise : of the pixels, gives weights and sigmas; None: that of the bench cell's camera
    """

    method: str = 'auto'
    channel: str = 'auto'
    min_snr: float = 6.0
    min_contrast: float = 0.01
    max_error: float = 0.6
    max_doubt: float = 0.3
    window: float = 3.0
    max_sigma: float = 12.0
    max_widening: float = 4.0
    smoothing: int = 5
    path: bool = True
    doubt: bool = True
    least_width: float | None = None
    along: float = 0.0
    noise: Noise | None = None

    def __post_init__(self) -> None:
        if self.method not in ('auto', *METHODS):
            known = ', '.join(('auto', *METHODS))
            raise ParameterError(f'method: {self.method!r} is not one of {known}')
        if self.channel != 'auto':
            channel.weights_of(self.channel)
        _require('min_snr', self.min_snr, 3.0 <= self.min_snr <= 100.0, '3 to 100')
        _require('min_contrast', self.min_contrast, 0.0 < self.min_contrast < 1.0, '0 to 1')
        _require('max_error', self.max_error, 0.0 < self.max_error <= 50.0, '0 to 50 pixels')
        _require('max_doubt', self.max_doubt, 0.0 < self.max_doubt <= 50.0, '0 to 50')
        _require('window', self.window, 1.0 <= self.window <= 5.0, '1 to 5')
        _require('max_sigma', self.max_sigma, 1.0 <= self.max_sigma <= 50.0, '1 to 50 pixels')
        widening = 1.0 < self.max_widening <= 50.0
        _require('max_widening', self.max_widening, widening, 'above 1, to 50')
        _require('along', self.along, 0.0 <= self.along <= 50.0, '0 to 50 rows')
        width = self.least_width
        if width is not None:
            _require('least_width', width, 0.1 <= width <= 50.0, '0.1 to 50 pixels')
        odd = self.smoothing % 2 == 1 and 1 <= self.smoothing <= 31
        _require('smoothing', self.smoothing, odd, 'odd, 1 to 31')


def _require(name: str, value: float, fits: bool, allowed: str) -> None:
    if not fits:
        raise ParameterError(f'{name}: {value} is out of range; it must be {allowed}')
