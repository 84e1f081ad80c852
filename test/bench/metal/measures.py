# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is compared: the default, glare off, the brightest pixel, the center of mass."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from bench.metal import pictures
from bench.metal.pictures import Shot
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.extract import ExtractSettings

KEEP_ALL = 50.0  # max_error, max_uncertainty: drop nothing
DEFAULT = ExtractSettings()
GLARE_OFF = ExtractSettings(glare='off')
_NOTHING_DROPPED = {
    'glare': 'off',
    'path': False,
    'shape_uncertainty': False,
    'max_error': KEEP_ALL,
    'max_uncertainty': KEEP_ALL,
}
ARGMAX = ExtractSettings(method='paper', **_NOTHING_DROPPED)
MASS = ExtractSettings(method='centre_of_mass', **_NOTHING_DROPPED)


class Product:
    """The acquisition of the product, which decides from the pictures of a part as in a scan."""

    def __init__(self, shots: Sequence[Shot], settings: ExtractSettings) -> None:
        factor = pictures.exposure(shots)
        first = [next(pictures.frames(shot, factor)) for shot in shots]
        self._acquisition = acquisition_of(shots[0].rig, settings).for_new_scan()
        self._acquisition.resolve_auto_settings(first)

    @property
    def settings(self) -> ExtractSettings:
        """The settings as they were decided."""
        return self._acquisition.settings.extract

    def __call__(self, shot: Shot, frames: Sequence[Frame]) -> Profile:
        """Return the profile of a shot; several frames are exposures of it."""
        frame, *others = frames
        bracket = tuple(other.image for other in others)
        return self._acquisition.profile(replace(frame, bracket=bracket))


@lru_cache(maxsize=32)
def acquisition_of(rig: str, settings: ExtractSettings) -> Acquisition:
    """Return the acquisition of a rig; its regions of interest take long."""
    cell = pictures.RIGS[rig].cell
    return Acquisition(cell, AcquisitionSettings(extract=settings))
