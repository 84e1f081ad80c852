# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Table angle of every picture of a scan: measured, optionally interpolated between pictures."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.turntable.axis_adjustment import AxisAdjustment
from ivfmc_ros.calibration.turntable.calibrate import angle_steps
from ivfmc_ros.calibration.turntable.observations import PlatterViews

# A measured angle with a greater standard deviation is not used: radians.
_MAX_ANGLE_STD = np.radians(0.5)


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureAngles:
    """
    Table angles of pictures by file name, unwrapped; the first is 0.

    by_name : radians
    filled : pictures without a detection, interpolated between their neighbors
    missing : pictures without an angle
    std : median of the 1 sigma of the measured angles, radians
    """

    by_name: dict[str, float]
    filled: tuple[str, ...]
    missing: tuple[str, ...]
    std: float

    @property
    def steps(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(n - 1,) radians from picture to picture."""
        return angle_steps(list(self.by_name.values()))


def collect_angles(
    views: PlatterViews, adjusted: AxisAdjustment, order: Sequence[str]
) -> PictureAngles:
    """
    Return the measured angles of a scan.

    order : names of all pictures, in the order in which they were taken
    """
    certain = adjusted.angle_std < _MAX_ANGLE_STD
    measured = {
        path.name: float(angle)
        for path, angle, keep in zip(views.pictures, adjusted.axis.angles, certain, strict=True)
        if keep
    }
    names = [name for name in order if name in measured]
    continuous = np.unwrap([measured[name] for name in names])
    return PictureAngles(
        by_name=dict(zip(names, (continuous - continuous[0]).tolist(), strict=True)),
        filled=(),
        missing=tuple(name for name in order if name not in measured),
        std=float(np.median(adjusted.angle_std)),
    )


def fill_gaps(angles: PictureAngles, order: Sequence[str]) -> PictureAngles:
    """Interpolate the missing angles between measured ones, linearly; do not extrapolate."""
    known: Mapping[str, float] = angles.by_name
    indices = [index for index, name in enumerate(order) if name in known]
    between = range(indices[0], indices[-1] + 1)
    values = np.interp(between, indices, [known[order[index]] for index in indices])
    by_name = {order[index]: float(v) for index, v in zip(between, values, strict=True)}
    return PictureAngles(
        by_name=by_name,
        filled=tuple(name for name in by_name if name not in known),
        missing=tuple(name for name in order if name not in by_name),
        std=angles.std,
    )
