# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Single ArUco markers: description, parsing, sub-pixel corner detection."""

from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import marker_dictionary
from ivfmc_ros.calibration.boards.board import parse_length
from ivfmc_ros.calibration.boards.board import to_gray
from ivfmc_ros.calibration.boards.edges import refine_quad
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.validation import require_in_range

_MARKER_SYNTAX = "'DICT_4X4_50:30mm' (dictionary, side)"


@dataclass(frozen=True)
class Markers:
    """Markers of one dictionary and one size; ``side`` of the black square in meters."""

    dictionary: str
    side: float

    def __post_init__(self) -> None:
        marker_dictionary(self.dictionary)
        require_in_range('markers: side', self.side, 0.0, 10.0, 'm', open_low=True, open_high=True)

    @property
    def corners_xyz(self) -> Floats:
        """(4, 3) meters: corners about the marker's center, in the order they are detected."""
        square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
        return np.asarray(0.5 * self.side * square)

    def __str__(self) -> str:
        return f'{self.dictionary}:{self.side * 1e3:g}mm'


def parse_markers(text: str) -> Markers:
    """
    Parse markers such as 'DICT_4X4_50:30mm'.

    :raises ParameterError: the text is not DICTIONARY:SIDE, or names no dictionary of cv2.aruco
    """
    dictionary, colon, side = text.partition(':')
    if not colon:
        raise ParameterError(f'markers: {text!r} is not understood; write {_MARKER_SYNTAX}')
    return Markers(dictionary, parse_length(side, 'markers'))


def find_markers(markers: Markers, image: Image) -> dict[int, Floats]:
    """
    Detect markers in a picture.

    returns : by id, the (4, 2) pixels of the corners, clockwise from the marker's upper left
    """
    gray = to_gray(image)
    detector = cv2.aruco.ArucoDetector(marker_dictionary(markers.dictionary))
    quads, ids, _ = detector.detectMarkers(gray)
    # ids is None without a detection, which OpenCV's type stubs omit
    numbers = np.ravel(ids) if len(quads) else np.empty(0)
    return {
        int(number): refine_quad(gray, np.asarray(quad, dtype=np.float64).reshape(4, 2))
        for number, quad in zip(numbers, quads, strict=True)
    }
