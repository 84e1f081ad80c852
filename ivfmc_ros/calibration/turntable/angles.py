# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table angle of every picture of a scan, measured and, if wanted, filled in between."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.turntable.axis_adjust import Adjusted
from ivfmc_ros.calibration.turntable.calibrate import steps_of
from ivfmc_ros.calibration.turntable.sightings import PlatterViews

# A picture so many medians of the standard deviation off is not believed.
_UNSURE = np.radians(0.5)


@dataclass(frozen=True, eq=False, kw_only=True)
class Angles:
    """
    Angles of pictures in radians, by file name, continuous; the first is 0.

    filled : those that no marker showed and that were interpolated between their neighbours
    missing : pictures without an angle
    std : typical 1 sigma of a measured one, radians
    """

    by_name: dict[str, float]
    filled: tuple[str, ...]
    missing: tuple[str, ...]
    std: float

    @property
    def steps(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(n - 1,) radians from picture to picture."""
        return steps_of(list(self.by_name.values()))


def angles_of(views: PlatterViews, adjusted: Adjusted, order: Sequence[str]) -> Angles:
    """
    Return the measured angles.

    order : names of all pictures, as the table went through them
    """
    sure = adjusted.angle_std < _UNSURE
    measured = {
        path.name: float(angle)
        for path, angle, is_sure in zip(views.pictures, adjusted.axis.angles, sure, strict=True)
        if is_sure
    }
    names = [name for name in order if name in measured]
    continuous = np.unwrap([measured[name] for name in names])
    return Angles(
        by_name=dict(zip(names, (continuous - continuous[0]).tolist(), strict=True)),
        filled=(),
        missing=tuple(name for name in order if name not in measured),
        std=float(np.median(adjusted.angle_std)),
    )


def fill_gaps(angles: Angles, order: Sequence[str]) -> Angles:
    """Interpolate angles of pictures between measured ones; none at the ends."""
    known: Mapping[str, float] = angles.by_name
    places = [place for place, name in enumerate(order) if name in known]
    between = range(places[0], places[-1] + 1)
    values = np.interp(between, places, [known[order[place]] for place in places])
    by_name = {order[p]: float(v) for p, v in zip(between, values, strict=True)}
    return Angles(
        by_name=by_name,
        filled=tuple(name for name in by_name if name not in known),
        missing=tuple(name for name in order if name not in by_name),
        std=angles.std,
    )
