# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes image files, one for each table angle, as a bag."""

from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
import math
from pathlib import Path
import re

import cv2
import numpy as np

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import FileError
from ivfmc_ros.image_bits import require_image_bits
from ivfmc_ros.image_bits import require_known_bits
from ivfmc_ros.image_bits import to_full_scale
from ivfmc_ros.image_bits import UNKNOWN
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import decode_picture
from ivfmc_ros.pictures import is_jpeg
from ivfmc_ros.pictures import is_png
from ivfmc_ros.pictures import read_bytes
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.validation import require_in_range

# Images whose number of bits is looked at.
_INSPECTED = 16

# Stamp of the first image, nanoseconds: fixed, so that the same images yield the same bag.
START_NS = 1_000_000_000 * cdr.NANOSECONDS

# Share of the time between two images during which the table stands still; arbitrary, since the
# files have no times.
_DWELL = 0.5

# Greatest difference of successive positions, radians: unwrapping is ambiguous from half a turn.
_MAX_POSITION_STEP = math.pi / 4
# Greatest angle from the first image to the last, radians: one turn, and an overlap of the same.
_MAX_TURN = 4.0 * math.pi + 1e-6
# A gap that is a greater share of all numbers is not made of single images that are missing.
_MAX_GAP_SHARE = 0.25
# Numbers in file names that are further apart on average are times or ids, not steps.
_MAX_MEAN_GAP = 1000


@dataclass(frozen=True, kw_only=True)
class ImageAtAngle:
    """An image file and the table angle, radians, at which it was taken."""

    path: Path
    angle: float


def images_by_number(images: Sequence[Path], step: float) -> tuple[list[ImageAtAngle], list[int]]:
    """
    Assign to each image the angle (number - first number) * step, by the last number in its name.

    step : radians from one number to the next, negative for clockwise
    :returns: the images by number, and the missing numbers between the first and the last
    :raises FileError: a name has no number, two have the same, or the numbers are not steps
    """
    numbered: dict[int, Path] = {}
    for path in images:
        number = _number(path)
        if number in numbered:
            raise FileError(
                f'{path}: has step number {number}, as {numbered[number].name}; keep one of them'
            )
        numbered[number] = path
    first, last = min(numbered), max(numbered)
    if last - first > _MAX_MEAN_GAP * len(numbered):
        raise FileError(
            f'{images[0].parent}: the names of {len(numbered)} images have numbers from '
            f'{first} to {last}, which are not steps; number the images, or give an angles file'
        )
    ordered = sorted(numbered)
    _require_one_turn(images[0].parent, ordered, step)
    # + 0.0 turns -0.0 into 0.0
    steps = [
        ImageAtAngle(path=numbered[number], angle=(number - first) * step + 0.0)
        for number in ordered
    ]
    return steps, sorted(set(range(first, last + 1)) - numbered.keys())


def brackets_by_number(
    images: Sequence[Path], step: float, exposures: int
) -> tuple[list[ImageAtAngle], list[int]]:
    """
    Assign angles to several exposures of each step, in the order of the last number in the names.

    The number before the last is that of the step, see ``images_by_number``.

    exposures : images of each step
    :raises FileError: as ``images_by_number``, or a step has another number of images
    """
    by_step: dict[int, list[tuple[int, Path]]] = {}
    for path in images:
        digits = re.findall(r'[0-9]+', path.stem)
        if len(digits) < 2:
            raise FileError(
                f'{path}: the name has no number of step and exposure; name the images '
                'step1_exposure1, step1_exposure2, ...'
            )
        by_step.setdefault(int(digits[-2]), []).append((int(digits[-1]), path))
    wrong = [number for number, found in sorted(by_step.items()) if len(found) != exposures]
    if wrong:
        raise FileError(
            f'{images[0].parent}: step {wrong[0]} has {len(by_step[wrong[0]])} images of '
            f'{exposures} exposures, as {len(wrong) - 1} other steps'
        )
    # any path with the number of the step as its last
    named = {number: Path(f'{images[0].parent}/{number}') for number in by_step}
    steps, gaps = images_by_number(list(named.values()), step)
    return [
        ImageAtAngle(path=path, angle=at.angle)
        for at in steps
        for _, path in sorted(by_step[int(at.path.name)])
    ], gaps


def _require_one_turn(folder: Path, numbers: Sequence[int], step: float) -> None:
    """
    Check that numbers can be steps of one turn.

    :raises FileError: they are those of a counter that began anew, of times or of dates
    """
    first, last = numbers[0], numbers[-1]
    turned = (last - first) * abs(step)
    cause = _other_meaning(numbers)
    if turned <= _MAX_TURN and not cause:
        return
    raise FileError(
        f'{folder}: the numbers {first} to {last} in the names of {len(numbers)} images are no '
        f'steps of one turn: at {math.degrees(abs(step)):g} degrees a step they are '
        f'{math.degrees(turned):.0f} degrees{cause and "; "}{cause}; number the images step1, '
        'step2, ..., correct --step, or give an angles file'
    )


def _other_meaning(numbers: Sequence[int]) -> str:
    """Return what ascending numbers seem to be instead of steps, or ''."""
    pairs = list(pairwise(numbers))
    is_full = str(numbers[-1]) in {'999', '9999', '99999', '65535'}
    gap = max((b - a for a, b in pairs), default=0)
    if numbers[0] <= 1 and is_full and gap > _MAX_GAP_SHARE * numbers[-1]:
        return f'a counter seems to have begun anew after {numbers[-1]}'
    if all(number % 100 < 60 for number in numbers) and any(
        a % 100 == 59 and b == a + 41 for a, b in pairs
    ):
        return 'they seem to be times of day'
    dates = all(19000101 <= n <= 21001231 and 1 <= n // 100 % 100 <= 12 for n in numbers)
    return 'they seem to be dates' if dates else ''


def _number(path: Path) -> int:
    digits = re.findall(r'[0-9]+', path.stem)
    if not digits:
        raise FileError(f'{path}: the name has no step number; name the images step1, step2, ...')
    return int(digits[-1])


def images_by_angles(
    images: Sequence[Path], angles: Mapping[str, float], source: Path
) -> list[ImageAtAngle]:
    """
    Assign to each image its measured angle.

    angles : radians by file name
    source : the file of the angles, for the error
    :returns: the images in the given order
    :raises FileError: an image has no angle
    """
    missing = [path for path in images if path.name not in angles]
    if missing:
        raise FileError(
            f'{source}: has no angle for {len(missing)} of {len(images)} images, the first '
            f'is {missing[0].name}; measure them as well, or remove them from the folder'
        )
    return [ImageAtAngle(path=path, angle=angles[path.name]) for path in images]


def import_images_as_bag(
    images: Sequence[ImageAtAngle],
    camera: Camera,
    folder: Path,
    *,
    rate: float = 10.0,
    joint: str = 'turntable_joint',
    laser: str | None = None,
    image_bits: int = UNKNOWN,
    progress: Progress = no_progress,
) -> None:
    """
    Write images and angles as a bag; JPEG and PNG files are stored without re-encoding.

    16-bit images of fewer significant bits are stored with full scale at 65535.

    folder : bag folder to create
    rate : images per second of the stamps
    joint : name of the table's joint
    laser : name of the laser that was on; None writes no laser_states
    image_bits : significant bits of 16-bit images; 0: unknown
    :raises FileError: an image cannot be read, or the bag cannot be written
    :raises CellError: an image has another size than the camera
    :raises ParameterError: the rate is not a positive number, or the images do not have
        ``image_bits``, or look like fewer bits
    """
    require_image_bits(image_bits)
    require_known_bits(_some(images), image_bits)
    require_in_range('rate', rate, 0.0, math.inf, 'images/s', open_low=True, open_high=True)
    with create_bag(folder) as bag:
        previous = images[0].angle
        for index, image in enumerate(images):
            stamp = START_NS + round(index * cdr.NANOSECONDS / rate)
            data, format = _read_encoded(image.path, camera, image_bits)
            _write_motion(bag, joint, stamp, rate, previous, image.angle)
            if laser is not None:
                bag.laser_state(stamp, {laser: True})
            bag.camera_info(stamp, camera)
            bag.compressed_image(stamp, data, format)
            previous = image.angle
            progress('import', index + 1, len(images))


def _some(images: Sequence[ImageAtAngle]) -> Iterator[Image]:
    """Yield a few images, spread over all."""
    for index in np.unique(np.linspace(0, len(images) - 1, _INSPECTED).astype(int)):
        yield read_picture(images[index].path)


def _read_encoded(path: Path, camera: Camera, bits: int) -> tuple[bytes, str]:
    """Return a complete image of the camera's size as JPEG or PNG bytes, and the format."""
    data = read_bytes(path)
    stored = decode_picture(data, str(path))
    camera.require_image_size(stored.shape, str(path))
    image = to_full_scale(stored, bits, str(path))
    if image is stored and is_jpeg(data):
        return data, 'jpeg'
    if image is stored and is_png(data):
        return data, 'png'
    # PNG is lossless for the other formats
    done, encoded = cv2.imencode('.png', image)
    if not done:
        raise FileError(f'{path}: cannot be encoded as PNG')
    return encoded.tobytes(), 'png'


def _write_motion(
    bag: BagWriter, joint: str, stamp: int, rate: float, previous: float, angle: float
) -> None:
    """Write joint states: the motion from the previous image, and standstill at this one."""
    period = cdr.NANOSECONDS / rate
    arrival = stamp - round(_DWELL * period)
    count = math.ceil(abs(angle - previous) / _MAX_POSITION_STEP)
    # without the ends: the previous image and the arrival have joint states of their own
    fractions = np.arange(1, count) / max(count, 1)
    departure = arrival - (1 - _DWELL) * period
    for fraction in fractions:
        at = departure + fraction * (arrival - departure)
        bag.joint_state(round(at), joint, previous + fraction * (angle - previous))
    bag.joint_state(arrival, joint, angle)
    bag.joint_state(stamp, joint, angle)
