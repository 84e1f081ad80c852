# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of a bag from simulated images, with the topics that a real cell records."""

from collections.abc import Iterable
from pathlib import Path

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Frame
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.storage.bag.writer import create_bag

# Time from the switching of a laser to the next exposure, nanoseconds: longer than the switching,
# shorter than the pause between two exposures.
_LASER_LEAD_NS = 5_000_000


def record_scan(
    folder: Path,
    cell: Cell,
    frames: Iterable[Frame],
    total: int = 0,
    progress: Progress = no_progress,
) -> None:
    """
    Write a bag of image_raw, camera_info, joint_states and laser_states.

    A change of the laser is stamped shortly before the exposure of the next image.

    folder : of the bag, new or empty
    frames : images in order of time, each with the index of its laser
    total : number of frames for ``progress``, 0 if unknown
    :raises FileError: the folder has files already, or cannot be written
    """
    active_laser = None
    with create_bag(folder, compress=False) as bag:
        for count, frame in enumerate(frames, start=1):
            if frame.laser != active_laser:
                active_laser = frame.laser
                names = [laser.name for laser in cell.lasers]
                states = {name: index == active_laser for index, name in enumerate(names)}
                bag.laser_state(frame.stamp_ns - _LASER_LEAD_NS, states)
            # without a velocity: the table stands at each image and has moved between two
            bag.joint_state(frame.stamp_ns, cell.turntable.joint, frame.angle)
            bag.camera_info(frame.stamp_ns, cell.camera)
            bag.image(frame.stamp_ns, frame.image)
            progress('recorded', count, max(total, count))
