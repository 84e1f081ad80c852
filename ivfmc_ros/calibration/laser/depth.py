# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check that a laser was calibrated over the depth of the working volume."""

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.volume import Volume


def depth_warning(
    laser: LaserPlane, turntable: Turntable, volume: Volume | None = None
) -> list[str]:
    """Return a warning if the working volume is not within the calibrated depth; else none."""
    if laser.volume is None:
        return []
    volume = volume or Volume()
    turn = np.linspace(0, 2 * np.pi, 60)
    rim = volume.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    outline = np.array([(x, y, z) for x, y in rim for z in (volume.bottom, volume.top)])
    depth = transforms.apply(turntable.camera_from_base, outline)[:, 2]
    low, high = laser.volume[:, 2]
    if low <= depth.min() and depth.max() <= high:
        return []
    return [
        f'laser {laser.name} was calibrated {low:.2f} to {high:.2f} m from the camera, but the '
        f'working volume is {depth.min():.2f} to {depth.max():.2f} m away; calibrate it with the '
        "board at these distances, or add --platter to 'ivfmc calibrate laser'"
    ]
