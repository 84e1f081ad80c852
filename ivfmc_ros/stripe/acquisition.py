# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One picture in, one profile out."""

from collections.abc import Iterable
from collections.abc import Sequence
import copy
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe import denoise
from ivfmc_ros.stripe.ambient import lit_by_laser
from ivfmc_ros.stripe.ambient import of_difference
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.extract import Stripe
from ivfmc_ros.stripe.region import Region
from ivfmc_ros.stripe.region import stripe_mask
from ivfmc_ros.stripe.space_time import refine
from ivfmc_ros.stripe.texture import coloured
from ivfmc_ros.stripe.triangulate import triangulate
from ivfmc_ros.validation import require_in_range

# A stripe that is narrower than this share of a scan's median may have been cut.
_NARROW = 0.5

# Where the usual sigma is more than this share of the stripe's width, the stripe is no bell:
# 0.04 on metal, 0.1 in heavy speckle, 0.5 on wax.
_GLOW = 0.25


@dataclass(frozen=True, kw_only=True)
class AcquisitionSettings:
    """
    How profiles are made. Lengths are metres.

    volume : what lies outside of it is not the part
    noise_distance : the paper's threshold between neighbours on a stripe
    noise_least : a piece of the stripe of fewer points is noise
    space_time : through so many pictures before and after a point is followed, where the angle
        steps are dense; 0 takes each picture by itself, as a live scan does
    """

    extract: ExtractSettings = field(default_factory=ExtractSettings)
    volume: Volume = field(default_factory=Volume)
    noise_distance: float = 2e-3
    noise_least: int = 4
    space_time: int = 0

    def __post_init__(self) -> None:
        require_in_range('noise_distance', self.noise_distance, 0.0, 1.0, 'm', open_low=True)
        require_in_range('noise_least', self.noise_least, 1, 1000, 'points')
        if self.space_time != 0:
            require_in_range('space_time', self.space_time, 2, 100, 'pictures (0: off)')


@dataclass(kw_only=True)
class AcquisitionCounts:
    """What became of the stripe points of a scan so far."""

    pictures: int = 0
    pictures_without_stripe: int = 0
    stripe_points: int = 0
    unconfirmed: int = 0
    outside_volume: int = 0
    noise: int = 0

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


class Acquisition:
    """
    Makes the profiles of a scan.

    :raises CellError: a picture has another size than the calibration, or another laser
    :raises GeometryError: the table angle of a picture is not known
    """

    def __init__(self, cell: Cell, settings: AcquisitionSettings) -> None:
        self.cell = cell
        masks = (stripe_mask(cell, k, settings.volume) for k in range(len(cell.lasers)))
        self._regions = [Region.of(mask) for mask in masks]
        self._given = settings
        self.settings = settings
        self.counts = AcquisitionCounts()

    def restarted(self) -> 'Acquisition':
        """Return one for another scan in this cell, without looking for the regions again."""
        other = copy.copy(self)
        other.settings = self._given
        other.counts = AcquisitionCounts()
        return other

    def prepare(self, frames: Iterable[Frame]) -> None:
        """
        Decide by some pictures what the settings leave open.

        These are the colours that measure the stripe, whether the material glows, and how narrow
        the stripe can be.
        """
        frames = list(frames)
        extraction = self.settings.extract
        if extraction.channel == 'auto':
            chosen = channel.unclipped_channel(self._masked(frame) for frame in frames)
            extraction = replace(extraction, channel=chosen)
        if extraction.method == 'auto':
            glows = self._glows(frames, extraction)
            extraction = replace(extraction, method='top_of_peak' if glows else DEFAULT)
        if extraction.least_width is None:
            extraction = replace(extraction, least_width=self._least_width(frames, extraction))
        self.settings = replace(self.settings, extract=extraction)

    def _glows(self, frames: Sequence[Frame], settings: ExtractSettings) -> bool:
        """Tell whether what the stripe looks like leaves its place in doubt nearly everywhere."""
        lenient = replace(settings, method=DEFAULT, max_doubt=50.0, max_error=50.0)
        found = [self._extract(frame, lenient) for frame in frames]
        doubts = [np.zeros(0), *(stripe.sigma / stripe.width for stripe in found)]
        doubt = np.concatenate(doubts)
        return bool(len(doubt) and np.median(doubt) > _GLOW)

    def _least_width(self, frames: Sequence[Frame], settings: ExtractSettings) -> float | None:
        widths = np.concatenate(
            [np.zeros(0), *(self._extract(frame, settings).width for frame in frames)]
        )
        if not len(widths):
            return None
        return float(np.clip(_NARROW * np.median(widths), 0.1, 50.0))

    def _extract(self, frame: Frame, settings: ExtractSettings) -> Stripe:
        direction = self.cell.lasers[frame.laser].stripe
        if frame.dark is not None:
            settings = replace(settings, noise=of_difference(settings.noise))
        return extract(lit_by_laser(frame), direction, settings, self._regions[frame.laser])

    def profile(
        self,
        frame: Frame,
        texture: Image | None = None,
        around: Sequence[Frame] = (),
    ) -> Profile:
        """
        Extract, triangulate and denoise the stripe of a picture.

        texture : the picture of the same table angle with all lasers off, for colours
        around : pictures of its sweep, it among them, through which its points are followed
        """
        self.require_usable(frame)
        settings = self.settings
        stripe = self._extract(frame, settings.extract)
        if around:
            whole = refine(self.cell, around, around.index(frame), stripe, settings.extract)
        else:
            whole = triangulate(self.cell, frame, stripe)
        inside = np.flatnonzero(settings.volume.contains(whole.points_xyz))
        points = whole.points_xyz[inside]
        clean = denoise.near_neighbours(points, settings.noise_distance, settings.noise_least)
        self.counts.pictures += 1
        self.counts.pictures_without_stripe += not clean.any()
        self.counts.stripe_points += len(stripe)
        self.counts.unconfirmed += len(stripe) - len(whole)
        self.counts.outside_volume += len(whole) - len(inside)
        self.counts.noise += int(np.count_nonzero(~clean))
        profile = denoise.keep(whole, inside[clean])
        return profile if texture is None else coloured(profile, texture)

    def _masked(self, frame: Frame) -> Image:
        """Return what can be stripe, turned so that there is one stripe point a row."""
        self.require_usable(frame)
        mask = self._regions[frame.laser].mask > 0
        image = lit_by_laser(frame) * (mask if frame.image.ndim == 2 else mask[..., None])
        by_row = self.cell.lasers[frame.laser].stripe == 'rows'
        return image if by_row else np.swapaxes(image, 0, 1)

    def require_usable(self, frame: Frame) -> None:
        """Refuse a picture that does not belong to the cell."""
        where = f'picture {frame.seq}'
        self.cell.camera.require_image(frame.image.shape, where)
        if not 0 <= frame.laser < len(self.cell.lasers):
            raise CellError(
                f'{where}: shows laser {frame.laser}, the cell has {len(self.cell.lasers)}; '
                'use the cell that the scan was made in'
            )
        if not math.isfinite(frame.angle):
            raise GeometryError(f'{where}: the table angle is {frame.angle}, not a number')
