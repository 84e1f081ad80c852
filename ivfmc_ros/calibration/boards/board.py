# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chessboard and ChArUco boards: description, parsing, sub-pixel corner detection (OpenCV)."""

from dataclasses import dataclass
from dataclasses import replace
from functools import cached_property
import math
import re
from typing import Any
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

BOARD_SYNTAX = (
    "'chessboard:8x6:40mm' (inner corners) or 'charuco:10x7:12mm:9mm:DICT_4X4_50' (squares)"
)

_LENGTH = re.compile(r'([0-9]*\.?[0-9]+)(mm|m)')
_GRID = re.compile(r'([0-9]+)x([0-9]+)')
# Percentile of the gray values taken as the brightness of paper: a stripe covers less than 5 %.
_WHITE_PERCENTILE = 95.0
# of cv2.cornerSubPix: at most 100 iterations, or a step below 1e-4 pixel
_SUBPIX_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
# Pixels of the rectified board per pixel of the picture. With 1.0, all corners of a board that
# faces the camera fall on the same fraction of a pixel and share its error of 0.035 px; with 1.5
# the error is 0.012 px.
_RECTIFIED_SCALE = 1.5
_UNITS = {'mm': 1e-3, 'm': 1.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class Corners:
    """
    Corners of a board detected in one picture.

    ids : (n,) int64, row of ``Board.corners_xyz``
    uv : (n, 2) float64, pixel (column, row)
    """

    ids: Ints
    uv: Floats

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, keep: Bools) -> 'Corners':
        """Return the corners for which ``keep``, (n,) bool, is true."""
        return Corners(ids=self.ids[keep], uv=self.uv[keep])


@dataclass(frozen=True)
class Board:
    """
    A flat board with corners at known positions in its own frame: z = 0, meters.

    chessboard : ``columns`` x ``rows`` inner corners, the first of them at the origin, x along
        the columns, y along the rows
    charuco : ``columns`` x ``rows`` squares of ``square`` with markers of ``marker``; the origin
        is the outer corner of the first square (cv2.aruco.CharucoBoard); ``legacy`` is the
        pattern of OpenCV before 4.6
    """

    kind: Literal['chessboard', 'charuco']
    columns: int
    rows: int
    square: float
    marker: float | None = None
    dictionary: str | None = None
    legacy: bool = False

    def __post_init__(self) -> None:
        require_one_of('board', self.kind, ('chessboard', 'charuco'))
        if self.columns < 3 or self.rows < 3:
            raise ParameterError(f'board: {self.columns}x{self.rows} is too small, 3x3 is least')
        require_in_range(
            'board: square', self.square, 0.0, math.inf, 'm', open_low=True, open_high=True
        )
        if self.kind == 'charuco':
            self._check_markers()

    def _check_markers(self) -> None:
        if self.marker is None or self.dictionary is None:
            raise ParameterError('board: a charuco board needs a marker length and a dictionary')
        if not 0 < self.marker < self.square:
            raise ParameterError('board: the marker must be smaller than the square')
        dictionary = marker_dictionary(self.dictionary)
        if len(dictionary.bytesList) < self.columns * self.rows // 2:
            raise ParameterError(
                f'board: {self.dictionary} has too few markers for {self.columns}x{self.rows}'
            )

    @cached_property
    def corners_xyz(self) -> Floats:
        """(n, 3) float64, meters, frame of the board: nominal corners in order of their ids."""
        if self.kind == 'charuco':
            return np.asarray(self.charuco().getChessboardCorners(), dtype=np.float64)
        y, x = np.mgrid[: self.rows, : self.columns].reshape(2, -1) * self.square
        return np.stack([x, y, np.zeros_like(x)], axis=1)

    def charuco(self) -> Any:
        """Return the cv2.aruco.CharucoBoard; :raises ParameterError: it is a chessboard."""
        if self.marker is None or self.dictionary is None:
            raise ParameterError('board: a chessboard has no markers')
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square,
            self.marker,
            marker_dictionary(self.dictionary),
        )
        board.setLegacyPattern(self.legacy)
        return board

    def other_pattern(self) -> 'Board | None':
        """
        Return the ChArUco board of the same text with the other pattern; None for a chessboard.

        OpenCV 4.6 changed the pattern of boards with an even number of rows; older prints are
        ``legacy``.
        """
        return replace(self, legacy=not self.legacy) if self.kind == 'charuco' else None

    def __str__(self) -> str:
        text = f'{self.kind}:{self.columns}x{self.rows}:{self.square * 1e3:g}mm'
        if self.marker is not None:
            text += f':{self.marker * 1e3:g}mm:{self.dictionary}'
        return text + (':legacy' if self.legacy else '')


def parse_board(text: str) -> Board:
    """
    Parse a board such as 'chessboard:8x6:40mm' or 'charuco:10x7:12mm:9mm:DICT_4X4_50[:legacy]'.

    :raises ParameterError: the text does not describe a possible board
    """
    kind, *parts = text.split(':')
    grid = _GRID.fullmatch(parts[0]) if parts else None
    if grid is None:
        raise ParameterError(f'board: {text!r} is not understood; write {BOARD_SYNTAX}')
    columns, rows = int(grid[1]), int(grid[2])
    lengths = [parse_length(part, 'board') for part in parts[1:3]]
    if kind == 'chessboard' and len(parts) == 2:
        return Board('chessboard', columns, rows, lengths[0])
    legacy = parts[4:] == ['legacy']
    if kind == 'charuco' and len(parts) == 4 + legacy:
        return Board('charuco', columns, rows, lengths[0], lengths[1], parts[3], legacy)
    raise ParameterError(f'board: {text!r} is not understood; write {BOARD_SYNTAX}')


def parse_length(text: str, name: str) -> float:
    """
    Parse a length such as '40mm' or '0.04m'; return meters.

    name : of the parameter, for the message of an error
    :raises ParameterError: the text has no unit or no positive number
    """
    found = _LENGTH.fullmatch(text.strip())
    if found is None or float(found[1]) == 0:
        raise ParameterError(f"{name}: {text!r} is no length; write it with its unit, as '40mm'")
    return float(found[1]) * _UNITS[found[2]]


def marker_dictionary(name: str) -> Any:
    """
    Return the predefined cv2.aruco dictionary of a name such as DICT_4X4_50.

    :raises ParameterError: cv2.aruco has no such dictionary
    """
    number = getattr(cv2.aruco, name, None) if name.startswith('DICT_') else None
    if not isinstance(number, int):
        raise ParameterError(f'{name!r} is no dictionary of cv2.aruco; write e.g. DICT_4X4_50')
    return cv2.aruco.getPredefinedDictionary(number)


def find_corners(board: Board, image: Image, *, with_stripe: bool = False) -> Corners | None:
    """
    Detect the corners of ``board`` in a picture with sub-pixel accuracy.

    A chessboard is detected completely or not at all (Duda & Frese 2018, OpenCV's SB detector);
    of a ChArUco board the visible corners are returned, at least four.

    image : (height, width) or (height, width, 3) BGR
    with_stripe : whether a laser stripe, brighter than the paper, is on the board
    returns : None if the board is not detected
    """
    gray = to_gray(image)
    pictures = [gray, _without_highlights(gray)]
    find = _find_charuco if board.kind == 'charuco' else _find_chessboard
    first, second = reversed(pictures) if with_stripe else pictures
    corners = find(board, first, True)
    return corners if corners is not None else find(board, second, False)


def to_gray(image: Image) -> NDArray[np.uint8]:
    """
    Return a picture as (height, width) uint8.

    The brightest value of 16 bits becomes full scale: many cameras send 10, 12 or 14 bits in the
    low ones, and the position of a corner does not depend on the scale.
    """
    if image.dtype == np.uint16:
        image = (image * (255.0 / max(int(image.max(initial=0)), 255))).astype(np.uint8)
    if image.ndim == 3:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)


def _find_chessboard(board: Board, gray: NDArray[np.uint8], thorough: bool) -> Corners | None:
    flags = cv2.CALIB_CB_ACCURACY | (cv2.CALIB_CB_EXHAUSTIVE if thorough else 0)
    found = cv2.findChessboardCornersSB(gray, (board.columns, board.rows), flags=flags)
    if not found[0]:
        return None
    uv = found[1]
    return Corners(ids=np.arange(len(uv)), uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2))


def _without_highlights(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the picture scaled to white paper and clipped: a stripe is as bright as the paper."""
    white = max(float(np.percentile(gray, _WHITE_PERCENTILE)), 1.0)
    return np.asarray(np.minimum(gray * (255.0 / white), 255.0), dtype=np.uint8)


def _find_charuco(board: Board, gray: NDArray[np.uint8], _: bool) -> Corners | None:
    uv, ids = cv2.aruco.CharucoDetector(board.charuco()).detectBoard(gray)[:2]
    if ids is None or len(ids) < 4:
        return None
    corners = Corners(
        ids=np.asarray(ids, dtype=np.int64).ravel(),
        uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2),
    )
    # OpenCV 4.8 returns corners off by half a pixel, 5.0 does not: both are refined here
    return _refine_rectified(board, corners, gray)


def _refine_rectified(board: Board, corners: Corners, gray: NDArray[np.uint8]) -> Corners:
    """
    Refine ChArUco corners in the rectified picture (warped by the homography of the board).

    In the picture itself, at grazing view, the search window would contain edges of markers,
    which moved corners by up to a pixel. In the rectified picture the window fits into the
    margin between marker and square.
    """
    xy = board.corners_xyz[corners.ids, :2]
    # returns None for collinear corners, which OpenCV's type stubs omit
    image_from_board: Any = cv2.findHomography(xy, corners.uv)[0]
    if image_from_board is None:
        return corners
    center = xy.mean(axis=0)
    probes = center + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) * 0.1 * board.square
    projected = cv2.perspectiveTransform(probes.reshape(-1, 1, 2), image_from_board).reshape(-1, 2)
    density = (
        _RECTIFIED_SCALE
        * np.linalg.norm(projected[1:] - projected[0], axis=1).max()
        / (0.1 * board.square)
    )
    board_from_rectified = np.diag([1 / density, 1 / density, 1.0])
    size = np.ceil(density * board.square * np.array([board.columns, board.rows])).astype(int)
    H = image_from_board @ board_from_rectified
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    rectified = cv2.warpPerspective(gray, H, (int(size[0]), int(size[1])), flags=flags)
    half_window = int(np.clip(0.5 * (board.square - (board.marker or 0.0)) * density, 3, 22))
    start = cv2.perspectiveTransform(corners.uv.reshape(-1, 1, 2), np.linalg.inv(H))
    found = cv2.cornerSubPix(
        rectified, start.astype(np.float32), (half_window, half_window), (-1, -1), _SUBPIX_CRITERIA
    )
    uv = cv2.perspectiveTransform(np.asarray(found, dtype=np.float64), H)
    return Corners(ids=corners.ids, uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2))
