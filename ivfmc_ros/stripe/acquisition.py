# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acquisition of profiles: stripe extraction, triangulation and noise removal for one image."""

from collections.abc import Callable
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
from ivfmc_ros.image_bits import require_known_bits
from ivfmc_ros.image_bits import to_full_scale
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe import denoise
from ivfmc_ros.stripe.ambient import noise_of_difference
from ivfmc_ros.stripe.ambient import subtract_ambient
from ivfmc_ros.stripe.clipping import Clipping
from ivfmc_ros.stripe.clipping import connected_extent
from ivfmc_ros.stripe.clipping import find_cuts
from ivfmc_ros.stripe.clipping import judge_clipping
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.exposure_bracket import merge_exposures
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.extract import rows_with_glare
from ivfmc_ros.stripe.extract import Stripe
from ivfmc_ros.stripe.glare import expected_width
from ivfmc_ros.stripe.glare import is_glaring
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.roi import stripe_mask
from ivfmc_ros.stripe.sheet_width import SheetVerdict
from ivfmc_ros.stripe.sheet_width import SheetWidth
from ivfmc_ros.stripe.space_time import space_time_profile
from ivfmc_ros.stripe.texture import with_colors
from ivfmc_ros.stripe.triangulate import triangulate
from ivfmc_ros.validation import require_in_range

# A stripe narrower than this fraction of the scan's median width may have been cut by an edge.
_MIN_WIDTH_FRACTION = 0.5

# Frames that are kept to find the volume that would hold the part, at most.
_MAX_CUT_FRAMES = 24

# A scan whose median sigma is above this fraction of the stripe's width shows a translucent
# material. Measured medians: 0.04 on metal, 0.1 in heavy speckle, 0.5 on wax.
_TRANSLUCENT_SIGMA = 0.25
# Unless positions without glare are this share of all, and their median is below this: inter-
# reflections on metal (0.07 there; 0.24 on a translucent part, pictures of the measured scan).
_MIN_CLEAN, _CLEAN_SIGMA = 0.1, 0.15
# Or unless the median width is above this multiple of the width of the thinnest stripes: 2.7 on
# the flange of ``bench metal`` with dim direct light, 1.1 and 1.3 in the measured scan.
_MAX_TRANSLUCENT_SPREAD = 2.0


def _is_thin_elsewhere(stripe: Stripe) -> bool:
    """Tell whether most of the positions are much wider than the thinnest ones."""
    thin = expected_width(stripe.width)
    return thin is not None and bool(np.median(stripe.width) > _MAX_TRANSLUCENT_SPREAD * thin)


def _fixed(method: str) -> str:
    return DEFAULT if method == 'auto' else method


@dataclass(frozen=True, kw_only=True)
class AcquisitionSettings:
    """
    Settings of the acquisition of profiles. Lengths are meters.

    volume : working volume; points outside of it are dropped
    noise_distance : largest distance between neighboring points of a stripe (Ismail et al. 2007)
    noise_least : minimum number of points of a connected stripe segment; shorter ones are noise
    space_time : number of images before and after that space-time analysis uses, for dense
        angle steps; 0: each image by itself, as in a live scan
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
    """
    Counts of the images and stripe points of a scan, and of the points dropped per reason.

    cut_radius, cut_top : images whose stripe goes on beyond radius or top of the working volume
    """

    pictures: int = 0
    pictures_without_stripe: int = 0
    stripe_points: int = 0
    unconfirmed: int = 0
    outside_volume: int = 0
    noise: int = 0
    cut_radius: int = 0
    cut_top: int = 0

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


class Acquisition:
    """
    Computes the profiles of a scan from its images.

    The methods raise:

    :raises CellError: the size of an image differs from the calibration, or its laser is unknown
    :raises GeometryError: the table angle of an image is not finite
    """

    def __init__(self, cell: Cell, settings: AcquisitionSettings) -> None:
        self.cell = cell
        masks = (stripe_mask(cell, k, settings.volume) for k in range(len(cell.lasers)))
        self._regions = [RegionOfInterest.of(mask) for mask in masks]
        self._initial_settings = settings
        self.settings = settings
        self.counts = AcquisitionCounts()
        self._sheets = SheetWidth(cell)
        self._forget_cuts()

    def for_new_scan(self) -> 'Acquisition':
        """Return a copy for another scan in this cell; the regions of interest are kept."""
        other = copy.copy(self)
        other.settings = self._initial_settings
        other.counts = AcquisitionCounts()
        other._sheets = SheetWidth(self.cell)
        other._forget_cuts()
        return other

    def _forget_cuts(self) -> None:
        self._cut_frames: list[Frame] = []
        self._cut_count, self._cut_stride = 0, 1

    def resolve_auto_settings(
        self, frames: Iterable[Frame], on_progress: Callable[[], object] = lambda: None
    ) -> None:
        """
        Resolve the settings that are ``auto`` or None from sample images of the scan.

        These are the color channel, the estimator (translucent material or not), whether there
        are inter-reflections, and the expected and the least width of the stripe.

        on_progress : called after each image that was searched
        :raises ParameterError: the images look like fewer bits than their pixels have
        """
        frames = list(frames)
        extraction = self.settings.extract
        require_known_bits((frame.image for frame in frames), extraction.image_bits)
        if extraction.channel == 'auto':
            chosen = channel.unclipped_channel(self._masked(frame) for frame in frames)
            extraction = replace(extraction, channel=chosen)
        if extraction.method == 'auto' or _looks_for_glare(extraction):
            found = self._everything_found(frames, extraction, on_progress)
            if extraction.method == 'auto':
                method = 'top_of_peak' if _is_translucent(*found) else DEFAULT
                extraction = replace(extraction, method=method)
            extraction = _with_glare(extraction, *found)
        else:
            extraction = replace(extraction, glare='off')
        if extraction.least_width is None:
            least = self._least_width(frames, extraction, on_progress)
            extraction = replace(extraction, least_width=least)
        self.settings = replace(self.settings, extract=extraction)

    def _everything_found(
        self,
        frames: Sequence[Frame],
        settings: ExtractSettings,
        on_progress: Callable[[], object] = lambda: None,
    ) -> tuple[Stripe, Bools]:
        """Return all positions of all images, none dropped, and which of them show glare."""
        lenient = replace(
            settings, method=DEFAULT, max_uncertainty=50.0, max_error=50.0, glare='off'
        )
        found, glare = [], [np.zeros(0, dtype=bool)]
        for frame in frames:
            found.append(self._extract(frame, lenient))
            image, direction = subtract_ambient(frame), self.cell.lasers[frame.laser].stripe
            region = self._regions[frame.laser]
            glare.append(rows_with_glare(image, direction, lenient, region, found[-1]))
            on_progress()
        return Stripe.concatenated(found), np.concatenate(glare)

    def _least_width(
        self, frames: Sequence[Frame], settings: ExtractSettings, on_progress: Callable[[], object]
    ) -> float | None:
        found = [np.zeros(0)]
        for frame in frames:
            found.append(self._extract(frame, settings).width)
            on_progress()
        widths = np.concatenate(found)
        if not len(widths):
            return None
        return float(np.clip(_MIN_WIDTH_FRACTION * np.median(widths), 0.1, 50.0))

    def _extract(self, frame: Frame, settings: ExtractSettings) -> Stripe:
        direction = self.cell.lasers[frame.laser].stripe
        if settings.glare == 'auto' and settings.expected_width is None:
            settings = replace(settings, method=_fixed(settings.method))
            if _looks_for_glare(settings):
                settings = _with_glare(settings, *self._everything_found([frame], settings))
            else:
                settings = replace(settings, glare='off')
        if frame.dark is not None:
            settings = replace(settings, noise=noise_of_difference(settings.noise))
        region = self._regions[frame.laser]
        stripe = extract(subtract_ambient(frame), direction, settings, region)
        if not frame.bracket:
            return stripe
        others = [extract(image, direction, settings, region) for image in frame.bracket]
        return merge_exposures([stripe, *others], direction)

    def profile(
        self,
        frame: Frame,
        texture: Image | None = None,
        around: Sequence[Frame] = (),
    ) -> Profile:
        """
        Extract, triangulate and denoise the stripe of an image.

        texture : image at the same table angle with all lasers off, for the colors of the points
        around : consecutive frames of the sweep, ``frame`` among them, for space-time analysis;
            empty: the frame alone is used
        """
        self.require_usable(frame)
        settings = self.settings
        stripe = self._extract(frame, settings.extract)
        if around:
            triangulated = space_time_profile(
                self.cell, around, around.index(frame), stripe, settings.extract
            )
        else:
            triangulated = triangulate(self.cell, frame, stripe)
        contained = settings.volume.contains(triangulated.points_xyz)
        inside = np.flatnonzero(contained)
        points = triangulated.points_xyz[inside]
        clean = denoise.filter_by_neighbor_distance(
            points, settings.noise_distance, settings.noise_least
        )
        by_radius, by_top = find_cuts(
            triangulated.points_xyz, contained, settings.volume, settings.noise_distance
        )
        self.counts.pictures += 1
        self.counts.cut_radius += by_radius
        self.counts.cut_top += by_top
        if by_radius or by_top:
            self._keep_cut_frame(frame)
        self.counts.pictures_without_stripe += not clean.any()
        self.counts.stripe_points += len(stripe)
        self.counts.unconfirmed += len(stripe) - len(triangulated)
        self.counts.outside_volume += len(triangulated) - len(inside)
        self.counts.noise += int(np.count_nonzero(~clean))
        profile = denoise.select_points(triangulated, inside[clean])
        if not frame.bracket:
            self._sheets.add(profile, stripe)
        return profile if texture is None else with_colors(profile, texture)

    def _keep_cut_frame(self, frame: Frame) -> None:
        """Keep a few frames, spread over all that are cut."""
        if self._cut_count % self._cut_stride == 0:
            self._cut_frames = [*self._cut_frames, frame]
        self._cut_count += 1
        if len(self._cut_frames) > _MAX_CUT_FRAMES:
            self._cut_frames, self._cut_stride = self._cut_frames[::2], 2 * self._cut_stride

    def clipping(self) -> Clipping | None:
        """Return how the working volume cuts the part; None if it does not."""
        counts = self.counts
        return judge_clipping(
            counts.pictures, counts.cut_radius, counts.cut_top, self.settings.volume
        )

    def clipping_with_extent(self) -> Clipping | None:
        """
        Return the same with the volume that would hold the part, which takes a second.

        It is found in some of the images that are cut.
        """
        found, frames = self.clipping(), self._cut_frames
        if found is None:
            return None
        counts, volume = self.counts, self.settings.volume
        larger = replace(volume, radius=2.0 * volume.radius, top=2.0 * abs(volume.top))
        wide = Acquisition(self.cell, replace(self.settings, volume=larger, space_time=0))
        limit = self.settings.noise_distance
        extents = [
            connected_extent(wide.profile(frame).points_xyz, volume, limit) for frame in frames
        ]
        return judge_clipping(counts.pictures, counts.cut_radius, counts.cut_top, volume, extents)

    def sheets(self) -> SheetVerdict | None:
        """Return whether the focus seems changed; None where the material shapes the stripe."""
        extraction = self.settings.extract
        shaped = extraction.glare == 'on' or extraction.method == 'top_of_peak'
        return None if shaped else self._sheets.judge()

    def _masked(self, frame: Frame) -> Image:
        """Return the region of interest, transposed so that there is one stripe point per row."""
        self.require_usable(frame)
        mask = self._regions[frame.laser].mask > 0
        image = subtract_ambient(frame) * (mask if frame.image.ndim == 2 else mask[..., None])
        by_row = self.cell.lasers[frame.laser].stripe == 'rows'
        return image if by_row else np.swapaxes(image, 0, 1)

    def prepare(self, frame: Frame) -> Frame:
        """
        Return a frame that fits the cell, its images scaled to the full range of their pixels.

        :raises CellError: the size of the image differs from the calibration, or unknown laser
        :raises GeometryError: the table angle is not finite
        :raises ParameterError: the image has more bits than ``image_bits``
        """
        self.require_usable(frame)
        bits, where = self.settings.extract.image_bits, f'image {frame.seq}'
        image = to_full_scale(frame.image, bits, where)
        if image is frame.image:
            return frame
        dark = None if frame.dark is None else to_full_scale(frame.dark, bits, where)
        return replace(frame, image=image, dark=dark)

    def require_usable(self, frame: Frame) -> None:
        """
        Check that a frame fits the cell.

        :raises CellError: the size of the image differs from the calibration, or unknown laser
        :raises GeometryError: the table angle is not finite
        """
        where = f'image {frame.seq}'
        self.cell.camera.require_image_size(frame.image.shape, where)
        if not 0 <= frame.laser < len(self.cell.lasers):
            raise CellError(
                f'{where}: laser index {frame.laser}, the cell has {len(self.cell.lasers)}; '
                'use the cell.yaml of the scan'
            )
        if not math.isfinite(frame.angle):
            raise GeometryError(f'{where}: the table angle is {frame.angle}, must be finite')


def _looks_for_glare(settings: ExtractSettings) -> bool:
    return settings.glare != 'off' and settings.method == DEFAULT


def _is_translucent(stripe: Stripe, glare: Bools) -> bool:
    """
    Tell whether the median uncertainty of the position shows a translucent material.

    Inter-reflections on metal make most positions uncertain, too, but not those without glare,
    and they leave the stripe thin elsewhere; a translucent material widens it everywhere.
    """
    relative_sigma = stripe.sigma / stripe.width
    if not len(stripe) or np.median(relative_sigma) <= _TRANSLUCENT_SIGMA:
        return False
    clean = relative_sigma[~glare]
    is_certain = len(clean) > _MIN_CLEAN * len(stripe) and np.median(clean) < _CLEAN_SIGMA
    return not (is_certain or _is_thin_elsewhere(stripe))


def _with_glare(settings: ExtractSettings, stripe: Stripe, glare: Bools) -> ExtractSettings:
    """Return the settings with ``glare`` on or off, and the expected width."""
    if not _looks_for_glare(settings):
        return replace(settings, glare='off')
    width = settings.expected_width or expected_width(stripe.width)
    if width is None:
        return settings
    shown = is_glaring(glare) or _is_thin_elsewhere(stripe)
    chosen = 'on' if settings.glare == 'on' or shown else 'auto'
    return replace(settings, glare=chosen, expected_width=width)
