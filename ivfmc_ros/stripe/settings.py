# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the stripe is found."""

from dataclasses import dataclass

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of


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
        require_one_of('method', self.method, ('auto', *METHODS))
        if self.channel != 'auto':
            channel.weights_of(self.channel)
        require_in_range('min_snr', self.min_snr, 3.0, 100.0)
        require_in_range(
            'min_contrast', self.min_contrast, 0.0, 1.0, open_low=True, open_high=True
        )
        require_in_range('max_error', self.max_error, 0.0, 50.0, 'pixels', open_low=True)
        require_in_range('max_doubt', self.max_doubt, 0.0, 50.0, open_low=True)
        require_in_range('window', self.window, 1.0, 5.0)
        require_in_range('max_sigma', self.max_sigma, 1.0, 50.0, 'pixels')
        require_in_range('max_widening', self.max_widening, 1.0, 50.0, open_low=True)
        require_in_range('along', self.along, 0.0, 50.0, 'rows')
        width = self.least_width
        if width is not None:
            require_in_range('least_width', width, 0.1, 50.0, 'pixels')
        require_in_range('smoothing', self.smoothing, 1, 31, 'pixels')
        if self.smoothing % 2 == 0:
            raise ParameterError(f'smoothing: {self.smoothing} is out of range; it must be odd')
