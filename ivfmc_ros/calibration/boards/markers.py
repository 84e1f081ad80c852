# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Single ArUco markers: how they are written, where their corners are seen."""

from dataclasses import dataclass

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import marker_dictionary
from ivfmc_ros.calibration.boards.board import parse_length
from ivfmc_ros.calibration.boards.board import to_gray
from ivfmc_ros.calibration.boards.edges import refine_square
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.validation import require_in_range

_FORM = "'DICT_4X4_50:30mm' (dictionary, side)"


@dataclass(frozen=True)
class Markers:
    """Markers of one dictionary and one size; ``side`` of the black square in metres."""

    dictionary: str
    side: float

    def __post_init__(self) -> None:
        marker_dictionary(self.dictionary)
        require_in_range('markers: side', self.side, 0.0, 10.0, 'm', open_low=True, open_high=True)

    @property
    def corners_xyz(self) -> Floats:
        """(4, 3) metres: corners about the marker's centre, in the order they are detected."""
        square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
        return np.asarray(0.5 * self.side * square)

    def __str__(self) -> str:
        return f'{self.dictionary}:{self.side * 1e3:g}mm'


def parse_markers(text: str) -> Markers:
    """
    Read markers such as 'DICT_4X4_50:30mm'.

    :raises ParameterError: it is none
    """
    dictionary, colon, side = text.partition(':')
    if not colon:
        raise ParameterError(f'markers: {text!r} is not understood; write {_FORM}')
    return Markers(dictionary, parse_length(side, 'markers'))


def find_markers(markers: Markers, image: Image) -> dict[int, Floats]:
    """
    Find markers in a picture.

    returns : for each id the (4, 2) pixels of its corners, clockwise from the upper left
    """
    gray = to_gray(image)
    detector = cv2.aruco.ArucoDetector(marker_dictionary(markers.dictionary))
    quads, ids, _ = detector.detectMarkers(gray)
    # None when there are none, whatever the stubs say
    numbers = np.ravel(ids) if len(quads) else np.empty(0)
    return {
        int(number): refine_square(gray, np.asarray(quad, dtype=np.float64).reshape(4, 2))
        for number, quad in zip(numbers, quads, strict=True)
    }
