# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Turns a folder of pictures, one a step of the table, into a bag."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path
import re

import cv2
import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pictures import decode_picture
from ivfmc_ros.pictures import is_jpeg
from ivfmc_ros.pictures import is_png
from ivfmc_ros.pictures import read_bytes
from ivfmc_ros.progress import Progress
from ivfmc_ros.progress import silent
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.messages import cdr

# Pictures do not say when they were taken; a fixed time makes the same bag of the same pictures.
START_NS = 1_000_000_000 * cdr.NANOSECONDS

# The table waits for a picture during this part of the time between two.
_DWELL = 0.5

# Reported positions are never further apart: half a turn and more could be taken for a wrap.
_MAX_JUMP = math.pi / 4
# Numbers that are farther apart, on the average, are times or names.
_SPARSE = 1000


@dataclass(frozen=True, kw_only=True)
class Step:
    """A picture and the table angle in radians at which it was taken."""

    path: Path
    angle: float


def steps_by_number(pictures: Sequence[Path], step: float) -> tuple[list[Step], list[int]]:
    """
    Give each picture the angle that the last number in its name says: (number - first) * step.

    step : radians from one number to the next, negative for clockwise
    returns : the steps in the order of their numbers, and the numbers that are missing between
    :raises FileError: a name holds no number, two hold the same, or they are no steps
    """
    numbered: dict[int, Path] = {}
    for path in pictures:
        number = _number(path)
        if number in numbered:
            raise FileError(
                f'{path}: is step {number}, and so is {numbered[number].name}; keep one of them'
            )
        numbered[number] = path
    first, last = min(numbered), max(numbered)
    if last - first > _SPARSE * len(numbered):
        raise FileError(
            f'{pictures[0].parent}: the names of {len(numbered)} pictures hold numbers from '
            f'{first} to {last}, which are no steps; number them, or say by angles what each is'
        )
    ordered = sorted(numbered)
    # 0.0 added: clockwise begins at 0, not at -0
    steps = [
        Step(path=numbered[number], angle=(number - first) * step + 0.0) for number in ordered
    ]
    return steps, sorted(set(range(first, last + 1)) - numbered.keys())


def _number(path: Path) -> int:
    digits = re.findall(r'[0-9]+', path.stem)
    if not digits:
        raise FileError(f'{path}: the name holds no step number; name pictures step1, step2, ...')
    return int(digits[-1])


def steps_by_angles(
    pictures: Sequence[Path], angles: Mapping[str, float], source: Path
) -> list[Step]:
    """
    Give each picture its measured angle.

    angles : file name -> radians, and the file ``source`` that says so
    returns : the steps in the order of the pictures
    :raises FileError: there are pictures without an angle
    """
    lacking = [path for path in pictures if path.name not in angles]
    if lacking:
        raise FileError(
            f'{source}: has no angle for {len(lacking)} of {len(pictures)} pictures, the first '
            f'is {lacking[0].name}; measure them too or move them away'
        )
    return [Step(path=path, angle=angles[path.name]) for path in pictures]


def import_steps(
    steps: Sequence[Step],
    camera: Camera,
    folder: Path,
    *,
    rate: float = 10.0,
    joint: str = 'turntable_joint',
    laser: str | None = None,
    progress: Progress = silent,
) -> None:
    """
    Write pictures and angles as a bag; JPEG and PNG files go into it as they are.

    rate : pictures a second that the bag claims
    laser : name of the laser that was on; None leaves laser_states out
    :raises FileError: a picture cannot be read, or the bag cannot be written
    :raises CellError: a picture has another size than the camera
    :raises ParameterError: the rate is not a positive number
    """
    if not (math.isfinite(rate) and rate > 0):
        raise ParameterError(f'rate: must be a positive number of pictures a second, is {rate}')
    with BagWriter(folder) as bag:
        previous = steps[0].angle
        for index, step in enumerate(steps):
            stamp = START_NS + round(index * cdr.NANOSECONDS / rate)
            data, format = _read(step.path, camera)
            _turn(bag, joint, stamp, rate, previous, step.angle)
            if laser is not None:
                bag.laser_state(stamp, {laser: True})
            bag.camera_info(stamp, camera)
            bag.compressed_image(stamp, data, format)
            previous = step.angle
            progress('import', index + 1, len(steps))


def _read(path: Path, camera: Camera) -> tuple[bytes, str]:
    """Return a picture file that is whole and of the camera, as JPEG or PNG, and its format."""
    data = read_bytes(path)
    image = decode_picture(data, str(path))
    camera.require_image(image.shape, str(path))
    if is_jpeg(data):
        return data, 'jpeg'
    if is_png(data):
        return data, 'png'
    # the others lose nothing as PNG
    done, encoded = cv2.imencode('.png', image)
    if not done:
        raise FileError(f'{path}: cannot be encoded as PNG')
    return encoded.tobytes(), 'png'


def _turn(
    bag: BagWriter, joint: str, stamp: int, rate: float, previous: float, angle: float
) -> None:
    """Write the table's way from the picture before, and that it stands still at this one."""
    period = cdr.NANOSECONDS / rate
    arrival = stamp - round(_DWELL * period)
    count = math.ceil(abs(angle - previous) / _MAX_JUMP)
    # the last of these is the arrival; the first is the picture before, where it has been said
    fractions = np.arange(1, count) / max(count, 1)
    departure = arrival - (1 - _DWELL) * period
    for fraction in fractions:
        at = departure + fraction * (arrival - departure)
        bag.joint_state(round(at), joint, previous + fraction * (angle - previous))
    bag.joint_state(arrival, joint, angle)
    bag.joint_state(stamp, joint, angle)
