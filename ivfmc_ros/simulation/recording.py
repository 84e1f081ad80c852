# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated pictures as a bag, as a cell without hardware would have recorded it."""

from collections.abc import Iterable
from pathlib import Path

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Frame
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.storage.bag.writer import create_bag

# longer than it takes to switch, shorter than the pause between two exposures
_SETTLING_NS = 5_000_000


def record_scan(
    folder: Path,
    cell: Cell,
    frames: Iterable[Frame],
    total: int = 0,
    progress: Progress = no_progress,
) -> None:
    """
    Write a bag of pictures, camera_info, joint_states and laser_states.

    A laser that is switched is reported some time before the next picture is exposed.

    :raises FileError: the folder has files already, or cannot be written
    """
    lit = None
    with create_bag(folder, compress=False) as bag:
        for count, frame in enumerate(frames, start=1):
            if frame.laser != lit:
                lit = frame.laser
                names = [laser.name for laser in cell.lasers]
                states = {name: index == lit for index, name in enumerate(names)}
                bag.laser_state(frame.stamp_ns - _SETTLING_NS, states)
            bag.joint_state(frame.stamp_ns, cell.turntable.joint, frame.angle, 0.0)
            bag.camera_info(frame.stamp_ns, cell.camera)
            bag.image(frame.stamp_ns, frame.image)
            progress('recorded', count, max(total, count))
