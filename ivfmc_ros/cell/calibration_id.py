# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Identity of a calibration: a hash of the numbers that place points in space."""

from collections.abc import Sequence
import hashlib
import json

from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import LaserPlane

_DIGITS = 12  # hexadecimal digits: two calibrations of one cell do not share them by chance


def calibration_id(turntable: Turntable, lasers: Sequence[LaserPlane]) -> str:
    """
    Return 12 hexadecimal digits that are equal for the same axis and laser planes.

    Names, notes, residuals and covariances do not count.
    """
    numbers = {
        'axis': turntable.camera_from_base.ravel().tolist(),
        'lasers': [
            [
                *laser.normal.tolist(),
                float(laser.offset),
                *([] if laser.bow is None else laser.bow.coefficients.tolist()),
            ]
            for laser in lasers
        ],
    }
    text = json.dumps(numbers, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
