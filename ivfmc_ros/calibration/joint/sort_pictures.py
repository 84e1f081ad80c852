# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Sorting of calibration pictures of all kinds, by what they show and by what they are called.

Which target is in a picture is seen in it. Which laser is on is read from the names of its folder
and file, because two stripes look alike.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import re

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.boards.markers import find_markers
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.calibration.boards.views import constrains_pose
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import picture_name
from ivfmc_ros.calibration.boards.views import picture_size
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.joint.steps import PictureSets
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Image
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress

_WORD = re.compile(r'[^a-z0-9]+')
_PLATTER_WORDS = ('platter', 'table')  # in names of pictures of the platter


@dataclass(frozen=True, eq=False, kw_only=True)
class SortedPictures:
    """
    Pictures by what they show.

    unknown : reason by name of each picture that shows nothing that is used
    """

    sets: PictureSets
    unknown: dict[str, str]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    path: Path
    laser: str | None
    corners: Corners | None
    target: bool


def sort_pictures(
    board: Board,
    target: Target,
    pictures: Sequence[Path],
    lasers: Mapping[str, Sequence[str]],
    progress: Progress = no_progress,
) -> SortedPictures:
    """
    Sort pictures into boards, boards with a stripe, the target on the platter, stripes on it.

    lasers : by name, the words in the name of a folder or file that say that this laser is on
    :raises CalibrationError: a name has the words of two lasers, or a kind of picture is missing
    :raises FileError: a picture cannot be read or has another size
    """
    size = picture_size(pictures[0])

    def look(path: Path) -> _Seen:
        image, laser = read_sized(path, size), _laser_of(path, lasers)
        if _shows_target(target, image, board, path):
            return _Seen(path=path, laser=laser, corners=None, target=True)
        corners = find_corners(board, image, with_stripe=laser is not None)
        if corners is not None and not constrains_pose(board, corners):
            corners = None
        return _Seen(path=path, laser=laser, corners=corners, target=False)

    seen = for_each_picture(look, pictures, 'sorted', progress)
    return _sets(seen, board, target, lasers, size)


def _laser_of(path: Path, lasers: Mapping[str, Sequence[str]]) -> str | None:
    words = _words_of(path)
    named = [name for name, own in lasers.items() if words & {word.lower() for word in own}]
    if len(named) > 1:
        raise CalibrationError(
            f'{path}: the name has the words of several lasers ({", ".join(named)}); '
            'put pictures of each laser into a folder of its own'
        )
    return named[0] if named else None


def _shows_target(target: Target, image: Image, board: Board, path: Path) -> bool:
    if isinstance(target, Markers):
        return bool(find_markers(target, image))
    if str(target) == str(board):
        # the same board is held by hand and lies on the platter: the name says which
        return bool(set(_PLATTER_WORDS) & _words_of(path))
    return find_corners(target, image) is not None


def _sets(
    seen: Sequence[_Seen],
    board: Board,
    target: Target,
    lasers: Mapping[str, Sequence[str]],
    size: tuple[int, int],
) -> SortedPictures:
    def boards(laser: str | None) -> BoardViews:
        found = tuple(
            BoardView(path=one.path, corners=one.corners)
            for one in seen
            if one.corners is not None and one.laser == laser
        )
        return BoardViews(found=found, missed=(), size=size)

    board_folders = {one.path.parent for one in seen if one.corners is not None}
    sets = PictureSets(
        board=boards(None),
        board_lasers={name: boards(name) for name in lasers},
        platter=tuple(one.path for one in seen if one.target),
        platter_lasers={
            name: tuple(
                one.path
                for one in seen
                if one.laser == name and (one.target or _is_bare_platter(one, board_folders))
            )
            for name in lasers
        },
    )
    _require_all_kinds(sets, board, target, lasers)
    used = {path for paths in sets.platter_lasers.values() for path in paths}
    unknown = {
        picture_name(one.path): f'neither {board} nor {target} detected, and no name of a laser'
        if one.laser is None
        else f'{board} not detected'
        for one in seen
        if one.corners is None and not one.target and one.path not in used
    }
    return SortedPictures(sets=sets, unknown=unknown)


def _is_bare_platter(one: _Seen, board_folders: set[Path]) -> bool:
    """
    Return whether a picture of a laser, in which nothing was detected, shows the bare platter.

    In a folder with pictures of the board it may be one in which the board was not detected,
    unless its name says platter or table.
    """
    if one.corners is not None:
        return False
    named = bool(set(_PLATTER_WORDS) & _words_of(one.path))
    return named or one.path.parent not in board_folders


def _words_of(path: Path) -> set[str]:
    return set(_WORD.split(f'{path.parent.name}_{path.stem}'.lower()))


def _require_all_kinds(
    sets: PictureSets, board: Board, target: Target, lasers: Mapping[str, Sequence[str]]
) -> None:
    for name, words in lasers.items():
        if not sets.board_lasers[name].found:
            raise CalibrationError(
                f'no picture shows {board} with the stripe of laser {name}: none that shows the '
                f'board has {" or ".join(map(repr, words))} in the name of its folder or file; '
                'name the lasers by --laser NAME=WORD'
            )
    if not sets.platter:
        raise CalibrationError(
            f'no picture shows {target}, which lies on the platter; check --platter: '
            'dictionary and size'
        )
