# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration boards: what they are, how they are written, where their corners are seen."""

from dataclasses import dataclass
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

FORMS = "'chessboard:8x6:40mm' (inner corners) or 'charuco:10x7:12mm:9mm:DICT_4X4_50' (squares)"

_LENGTH = re.compile(r'([0-9]*\.?[0-9]+)(mm|m)')
_GRID = re.compile(r'([0-9]+)x([0-9]+)')
# Percentile of the pixels that is as bright as paper where a stripe is brighter.
_WHITE = 95.0
_SUBPIX = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
# Pixels of the view from above for one of the picture: at one to one, all corners of a board seen
# straight fall on the same fraction of a pixel and share its error (0.035 px, 0.012 px with 1.5).
_FINER = 1.5
_UNITS = {'mm': 1e-3, 'm': 1.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class Corners:
    """
    Corners of a board as one picture shows them.

    ids : (n,) int64, row of ``Board.corners_xyz``
    uv : (n, 2) float64, pixel (column, row)
    """

    ids: Ints
    uv: Floats

    def __len__(self) -> int:
        return len(self.ids)

    def chosen(self, keep: Bools) -> 'Corners':
        """Return only the chosen corners, (n,) bool."""
        return Corners(ids=self.ids[keep], uv=self.uv[keep])


@dataclass(frozen=True)
class Board:
    """
    A flat board with corners at known places, in a frame of its own: z = 0, metres.

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
        """(n, 3) float64, metres, frame of the board: where its corners are, in order of ids."""
        if self.kind == 'charuco':
            return np.asarray(self.charuco().getChessboardCorners(), dtype=np.float64)
        y, x = np.mgrid[: self.rows, : self.columns].reshape(2, -1) * self.square
        return np.stack([x, y, np.zeros_like(x)], axis=1)

    def charuco(self) -> Any:
        """Return the cv2.aruco.CharucoBoard."""
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

    def __str__(self) -> str:
        text = f'{self.kind}:{self.columns}x{self.rows}:{self.square * 1e3:g}mm'
        if self.marker is not None:
            text += f':{self.marker * 1e3:g}mm:{self.dictionary}'
        return text + (':legacy' if self.legacy else '')


def parse_board(text: str) -> Board:
    """
    Read a board such as 'chessboard:8x6:40mm' or 'charuco:10x7:12mm:9mm:DICT_4X4_50[:legacy]'.

    :raises ParameterError: it is none
    """
    kind, *parts = text.split(':')
    grid = _GRID.fullmatch(parts[0]) if parts else None
    if grid is None:
        raise ParameterError(f'board: {text!r} is not understood; write {FORMS}')
    columns, rows = int(grid[1]), int(grid[2])
    lengths = [parse_length(part, 'board') for part in parts[1:3]]
    if kind == 'chessboard' and len(parts) == 2:
        return Board('chessboard', columns, rows, lengths[0])
    legacy = parts[4:] == ['legacy']
    if kind == 'charuco' and len(parts) == 4 + legacy:
        return Board('charuco', columns, rows, lengths[0], lengths[1], parts[3], legacy)
    raise ParameterError(f'board: {text!r} is not understood; write {FORMS}')


def parse_length(text: str, name: str) -> float:
    """
    Read a length such as '40mm' or '0.04m' and return metres.

    :raises ParameterError: it has no unit or is no positive number; ``name`` says of what
    """
    found = _LENGTH.fullmatch(text.strip())
    if found is None or float(found[1]) == 0:
        raise ParameterError(f"{name}: {text!r} is no length; write it with its unit, as '40mm'")
    return float(found[1]) * _UNITS[found[2]]


def marker_dictionary(name: str) -> Any:
    """
    Return the cv2.aruco dictionary of a name such as DICT_4X4_50.

    :raises ParameterError: there is none
    """
    number = getattr(cv2.aruco, name, None) if name.startswith('DICT_') else None
    if not isinstance(number, int):
        raise ParameterError(f'{name!r} is no dictionary of cv2.aruco; write e.g. DICT_4X4_50')
    return cv2.aruco.getPredefinedDictionary(number)


def find_corners(board: Board, image: Image, *, lit: bool = False) -> Corners | None:
    """
    Find the corners of ``board`` in a picture, to a fraction of a pixel.

    A chessboard is found whole or not at all (Duda & Frese 2018, OpenCV's SB detector); of a
    charuco board the corners that are seen, at least four.

    image : (height, width) or (height, width, 3) BGR
    lit : whether a stripe is on the board, brighter than its paper
    """
    gray = to_gray(image)
    pictures = [gray, _without_highlights(gray)]
    find = _find_charuco if board.kind == 'charuco' else _find_chess
    first, second = reversed(pictures) if lit else pictures
    corners = find(board, first, True)
    return corners if corners is not None else find(board, second, False)


def to_gray(image: Image) -> NDArray[np.uint8]:
    """Return a picture as (height, width) uint8."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 3:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return np.asarray(image, dtype=np.uint8)


def _find_chess(board: Board, gray: NDArray[np.uint8], thorough: bool) -> Corners | None:
    flags = cv2.CALIB_CB_ACCURACY | (cv2.CALIB_CB_EXHAUSTIVE if thorough else 0)
    found = cv2.findChessboardCornersSB(gray, (board.columns, board.rows), flags=flags)
    if not found[0]:
        return None
    uv = found[1]
    return Corners(ids=np.arange(len(uv)), uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2))


def _without_highlights(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture stretched to its white, so that a stripe is no brighter than the paper."""
    white = max(float(np.percentile(gray, _WHITE)), 1.0)
    return np.asarray(np.minimum(gray * (255.0 / white), 255.0), dtype=np.uint8)


def _find_charuco(board: Board, gray: NDArray[np.uint8], _: bool) -> Corners | None:
    uv, ids = cv2.aruco.CharucoDetector(board.charuco()).detectBoard(gray)[:2]
    if ids is None or len(ids) < 4:
        return None
    corners = Corners(
        ids=np.asarray(ids, dtype=np.int64).ravel(),
        uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2),
    )
    # OpenCV 4.8 gives corners half a pixel off, 5.0 does not: what is measured here is neither's
    return _refined(board, corners, gray)


def _refined(board: Board, corners: Corners, gray: NDArray[np.uint8]) -> Corners:
    """
    Measure charuco corners in a picture of the board seen from straight above.

    A window in the picture itself would take in edges of markers where the board is seen at a low
    angle, which moved corners by a pixel; from above it can be as large as the markers' margin.
    """
    xy = board.corners_xyz[corners.ids, :2]
    # None for corners in a line, which the stubs do not know
    image_from_board: Any = cv2.findHomography(xy, corners.uv)[0]
    if image_from_board is None:
        return corners
    center = xy.mean(axis=0)
    near = center + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) * 0.1 * board.square
    spots = cv2.perspectiveTransform(near.reshape(-1, 1, 2), image_from_board).reshape(-1, 2)
    density = _FINER * np.linalg.norm(spots[1:] - spots[0], axis=1).max() / (0.1 * board.square)
    board_from_above = np.diag([1 / density, 1 / density, 1.0])
    size = np.ceil(density * board.square * np.array([board.columns, board.rows])).astype(int)
    H = image_from_board @ board_from_above
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    above = cv2.warpPerspective(gray, H, (int(size[0]), int(size[1])), flags=flags)
    reach = int(np.clip(0.5 * (board.square - (board.marker or 0.0)) * density, 3, 22))
    start = cv2.perspectiveTransform(corners.uv.reshape(-1, 1, 2), np.linalg.inv(H))
    found = cv2.cornerSubPix(above, start.astype(np.float32), (reach, reach), (-1, -1), _SUBPIX)
    uv = cv2.perspectiveTransform(np.asarray(found, dtype=np.float64), H)
    return Corners(ids=corners.ids, uv=np.asarray(uv, dtype=np.float64).reshape(-1, 2))
