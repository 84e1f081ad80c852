# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a set of board pictures still lacks: places in the image, tilts, distances, and their number.

Tilts and distances need a focal length; before the calibration a typical one is good enough to
tell a tilt of 30 degrees from one of 10.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.model import Floats

# Pictures that determine a camera well (the calibration accepts 6).
ENOUGH = 20
# Focal length over image width before the calibration: between a wide and a long lens.
TYPICAL_FOCAL = 1.5
_GRID = 3  # fields of the image along each side that must have seen corners
_MIN_FIELD_CORNERS = 4  # of one picture in a field
_TILT = np.radians(20.0)  # in each of four directions, at least once
# Ratio of the greatest to the least distance: focal length and distance separate by it.
_MIN_DISTANCE_RATIO = 1.25
# A picture is new if its board moved by this share of the image, or turned by this angle.
_MIN_SHIFT = 0.04
_MIN_TURN = np.radians(6.0)
# Kinds of what a set lacks.
TILT, PLACE, DISTANCE, NUMBER = 'tilt', 'place', 'distance', 'number'
_ROWS = ('upper', 'middle', 'lower')
_COLUMNS = ('left', 'middle', 'right')
# Axis of the normal towards the camera, and the sign of the tilt about the other one.
_TILTS = {
    'right side towards the camera': (0, 1.0),
    'left side towards the camera': (0, -1.0),
    'lower side towards the camera': (1, 1.0),
    'upper side towards the camera': (1, -1.0),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardView3d:
    """
    A board in a picture, with a typical focal length.

    center : (2,) of the corners, share of width and height of the image
    normal : (3,) unit, towards the camera
    distance : meters
    fields : places of the image that have corners, (row, column)
    """

    center: Floats
    normal: Floats
    distance: float
    fields: frozenset[tuple[int, int]]


@dataclass(frozen=True)
class CaptureGuide:
    """
    The pictures taken so far.

    board : to be seen
    size : (width, height) of the pictures, pixels
    """

    board: Board
    size: tuple[int, int]
    views: tuple[BoardView3d, ...] = ()

    def add(self, corners: Corners) -> tuple['CaptureGuide', str]:
        """
        Return the guide with one more picture, and '' or why it adds nothing.

        corners : of the board in the picture
        """
        view = self._view(corners)
        if view is None:
            return self, 'the pose of the board cannot be told from these corners'
        if any(_are_alike(view, other) for other in self.views):
            return self, 'the board stands as in another picture; move or tilt it'
        return CaptureGuide(self.board, self.size, (*self.views, view)), ''

    @property
    def coverage(self) -> float:
        """Share of the fields of the image that have seen corners."""
        return len(self._fields()) / _GRID**2

    @property
    def is_complete(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing()

    def missing(self) -> tuple[str, ...]:
        """Return what the set lacks, the most important first; empty if it is complete."""
        return tuple(text for _, _, text in self.lacks())

    def lacks(self) -> list[tuple[str, tuple[int, float], str]]:
        """
        Return what the set lacks as (kind, key, text), the most important first.

        The key of a tilt is (axis of the normal, sign), that of a place (row, column).
        """
        found = [
            (TILT, _TILTS[name], f'tilt the board by 30 degrees, its {name}')
            for name in self._missing_tilts()
        ]
        seen = self._fields()
        found += [
            (
                PLACE,
                (row, column),
                f'hold the board in the {_ROWS[row]} {_COLUMNS[column]} of the image',
            )
            for row in range(_GRID)
            for column in range(_GRID)
            if (row, column) not in seen
        ]
        distances = [view.distance for view in self.views]
        if not distances or max(distances) < _MIN_DISTANCE_RATIO * min(distances):
            text = 'hold the board nearer, and farther away, by a quarter of its distance'
            found.append((DISTANCE, (0, 0.0), text))
        if len(self.views) < ENOUGH:
            found.append((NUMBER, (0, 0.0), f'take {ENOUGH - len(self.views)} pictures more'))
        return found

    def _fields(self) -> set[tuple[int, int]]:
        return {field for view in self.views for field in view.fields}

    def _missing_tilts(self) -> list[str]:
        return [
            name
            for name, (axis, sign) in _TILTS.items()
            if not any(sign * view.normal[axis] < -np.sin(_TILT) for view in self.views)
        ]

    def _view(self, corners: Corners) -> BoardView3d | None:
        width, height = self.size
        focal = TYPICAL_FOCAL * width
        K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        points = self.board.corners_xyz[corners.ids]
        found, turn, shift = cv2.solvePnP(
            points, corners.uv.reshape(-1, 1, 2), K, None, flags=cv2.SOLVEPNP_IPPE
        )
        if not found or len(corners) < _MIN_FIELD_CORNERS:
            return None
        normal = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)[:, 2]
        normal = -normal * np.sign(normal[2])
        place = np.floor(corners.uv / self.size * _GRID).clip(0, _GRID - 1).astype(int)
        fields, counts = np.unique(place[:, ::-1], axis=0, return_counts=True)
        return BoardView3d(
            center=np.asarray(corners.uv.mean(axis=0) / self.size),
            normal=normal,
            distance=float(shift[2, 0]),
            fields=frozenset(
                (int(row), int(column))
                for (row, column), count in zip(fields, counts, strict=True)
                if count >= _MIN_FIELD_CORNERS
            ),
        )


def _are_alike(one: BoardView3d, other: BoardView3d) -> bool:
    near = np.linalg.norm(one.center - other.center) < _MIN_SHIFT
    turned = np.arccos(np.clip(one.normal @ other.normal, -1.0, 1.0)) >= _MIN_TURN
    farther = abs(np.log(one.distance / other.distance)) >= _MIN_SHIFT
    return bool(near and not turned and not farther)
