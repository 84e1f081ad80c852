# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the laser stripe extraction."""

from dataclasses import dataclass

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.image_bits import require_image_bits
from ivfmc_ros.image_bits import UNKNOWN
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of


@dataclass(frozen=True, kw_only=True)
class ExtractSettings:
    """
    Settings of the laser stripe extraction.

    method : estimator of the sub-pixel stripe position, one of ``METHODS``; auto: gaussian, or
        top_of_peak if the first images of a scan show a translucent material
    channel : color channels that are averaged, such as blue+red; auto: those that do not saturate
    min_snr : minimum height of the stripe, in standard deviations of the estimated height
    min_contrast : minimum height of the stripe above its background, fraction of full scale
    max_error : pixels; points with a larger sigma from pixel noise are dropped (method paper
        ignores this limit)
    max_uncertainty : points whose total sigma (pixel noise and ``shape_uncertainty``) exceeds
        this fraction of the stripe's width are dropped
    window : half the width of the window of the estimate, in sigmas of the stripe
    max_sigma : pixels; peaks with a larger sigma are rejected
    max_widening : peaks wider than this multiple of the image's median width are rejected
    smoothing : pixels, odd; width of the box filter of the peak search
    path : choose among several peaks in a row by a minimum-cost path along the stripe
    shape_uncertainty : add to sigma the uncertainty due to a profile that is not Gaussian
    least_width : pixels; a stripe with a smaller sigma is taken as cut by an edge; None:
        estimated from the first images of a scan, no limit in a single image
    glare : search for a thin stripe beside broad light, which inter-reflections on metal cause:
        on, off, or auto: in all images if the first ones of a scan show such light, and else in
        those that show it
    expected_width : pixels; sigma of the directly lit stripe for this search; None: from the
        first images of a scan (in a single image auto is off without it)
    along : rows; sigma of the Gaussian that smooths positions along the stripe; 0: off
    image_bits : significant bits of 16-bit images, 8 to 16, where the camera sends 10, 12 or 14
        bits in the low ones; 0: unknown, and images that look like fewer bits are refused
    noise : noise model of the pixels, for weights and sigmas; None: the bench cell's camera
    """

    method: str = 'auto'
    channel: str = 'auto'
    min_snr: float = 6.0
    min_contrast: float = 0.01
    max_error: float = 0.6
    max_uncertainty: float = 0.3
    window: float = 3.0
    max_sigma: float = 12.0
    max_widening: float = 4.0
    smoothing: int = 5
    path: bool = True
    shape_uncertainty: bool = True
    least_width: float | None = None
    glare: str = 'auto'
    expected_width: float | None = None
    along: float = 0.0
    image_bits: int = UNKNOWN
    noise: SensorNoise | None = None

    def __post_init__(self) -> None:
        require_one_of('method', self.method, ('auto', *METHODS))
        if self.channel != 'auto':
            channel.channel_weights(self.channel)
        require_in_range('min_snr', self.min_snr, 3.0, 100.0)
        require_in_range(
            'min_contrast', self.min_contrast, 0.0, 1.0, open_low=True, open_high=True
        )
        require_in_range('max_error', self.max_error, 0.0, 50.0, 'pixels', open_low=True)
        require_in_range('max_uncertainty', self.max_uncertainty, 0.0, 50.0, open_low=True)
        require_in_range('window', self.window, 1.0, 5.0)
        require_in_range('max_sigma', self.max_sigma, 1.0, 50.0, 'pixels')
        require_in_range('max_widening', self.max_widening, 1.0, 50.0, open_low=True)
        require_in_range('along', self.along, 0.0, 50.0, 'rows')
        require_image_bits(self.image_bits)
        require_one_of('glare', self.glare, ('auto', 'on', 'off'))
        for name in ('least_width', 'expected_width'):
            width = getattr(self, name)
            if width is not None:
                require_in_range(name, width, 0.1, 50.0, 'pixels')
        require_in_range('smoothing', self.smoothing, 1, 31, 'pixels')
        if self.smoothing % 2 == 0:
            raise ParameterError(f'smoothing: {self.smoothing} is out of range; it must be odd')
