# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate live``: guidance while pictures of a board are taken."""

from pathlib import Path
import sys
import time

import click

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.picture import picture_quality
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.errors import FileError
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.pictures import read_picture

_PERIOD_S = 0.5  # between two looks into the folder
_TOLD = 3  # of what is missing, after each picture
# A picture that cannot be read yet is tried again for so long: its program still writes it.
_PATIENCE_S = 5.0


@click.command()
@click.argument('folder', metavar='FOLDER', type=options.PATH)
@options.board_option
@click.option('--once', is_flag=True, help='Judge the pictures that are there, and end.')
@click.option(
    '--timeout',
    type=click.FloatRange(1.0, 1e6),
    default=600.0,
    show_default=True,
    metavar='SECONDS',
    help='End when no new picture has come for so long.',
)
def live(folder: Path, board: Board, once: bool, timeout: float) -> None:
    """
    Guide the taking of pictures of a board into FOLDER.

    Each new picture is judged (sharpness, exposure, size, whether it shows anything new), and
    what the set still lacks is said. Ends with exit code 0 when the set is complete, with 1 if it
    is not.
    """
    guide: CaptureGuide | None = None
    done: set[Path] = set()
    last = time.monotonic()
    while True:
        for path in _new_pictures(folder, done, once):
            guide = _judge(path, board, guide)
            done.add(path)
            last = time.monotonic()
        if guide is not None and guide.is_complete:
            options.print_line('the set is complete')
            return
        if once or time.monotonic() - last > timeout:
            break
        time.sleep(_PERIOD_S)
    for text in guide.missing() if guide is not None else ('no picture came',):
        options.print_line(f'missing: {text}')
    sys.exit(1)


def _new_pictures(folder: Path, done: set[Path], once: bool) -> list[Path]:
    """Return new pictures; :raises FileError: the folder is none, or once and it is empty."""
    if not folder.is_dir():
        raise FileError(f'{folder}: the folder does not exist; make it first')
    try:
        return [path for path in list_pictures(folder) if path not in done]
    except FileError:
        if once:
            raise
        return []


def _judge(path: Path, board: Board, guide: CaptureGuide | None) -> CaptureGuide | None:
    image = _read(path)
    height, width = image.shape[:2]
    guide = guide or CaptureGuide(board, (width, height))
    if guide.size != (width, height):
        raise FileError(
            f'{path}: the picture is {width} x {height}, the ones before '
            f'{guide.size[0]} x {guide.size[1]}; use one camera at one size'
        )
    corners = find_corners(board, image)
    if corners is None:
        options.print_line(f'{path.name}: refused: the board is not detected; show all of it')
        return guide
    faults = picture_quality(board, corners, image).faults()
    if not faults:
        guide, reason = guide.add(corners)
        faults = (reason,) if reason else ()
    if faults:
        options.print_line(f'{path.name}: refused: {"; ".join(faults)}')
        return guide
    options.print_line(
        f'{path.name}: good, {len(guide.views)} pictures, {guide.coverage:.0%} of the image'
    )
    for text in guide.missing()[:_TOLD]:
        options.print_line(f'  next: {text}')
    return guide


def _read(path: Path) -> Image:
    """Read a picture that may still be written; :raises FileError: it stays unreadable."""
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return read_picture(path)
        except FileError:
            if time.monotonic() > deadline:
                raise
            time.sleep(_PERIOD_S)
