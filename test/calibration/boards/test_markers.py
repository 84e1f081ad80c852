# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import marker_dictionary
from ivfmc_ros.calibration.boards.edges import bloom_jacobian
from ivfmc_ros.calibration.boards.edges import refine_quad
from ivfmc_ros.calibration.boards.markers import find_markers
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.errors import ParameterError

MARKERS = parse_markers('DICT_4X4_50:30mm')


def warped(quad):
    """A picture of marker 7 with its outer corners at ``quad``."""
    marker = cv2.aruco.generateImageMarker(marker_dictionary('DICT_4X4_50'), 7, 600)
    sheet = np.full((1000, 1000), 255, np.uint8)
    sheet[200:800, 200:800] = marker
    edge = np.float32([[199.5, 199.5], [799.5, 199.5], [799.5, 799.5], [199.5, 799.5]])
    # drawn eight times as large and averaged, as a sensor does
    H = cv2.getPerspectiveTransform(edge, np.float32(8 * quad + 3.5))
    large = cv2.warpPerspective(sheet, H, (1600, 1600), borderValue=255)
    small = cv2.resize(large, (200, 200), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), 0.8)


QUAD = np.array([[60.3, 72.1], [131.7, 66.4], [140.2, 120.9], [52.6, 128.3]])


def test_markers_are_written_as_they_are_read():
    assert str(MARKERS) == 'DICT_4X4_50:30mm'
    assert MARKERS.side == pytest.approx(0.03)


@pytest.mark.parametrize('text', ['DICT_4X4_50', 'DICT_4X4_50:30', '4X4:30mm', 'DICT_4X4_50:0mm'])
def test_impossible_markers_are_refused(text):
    with pytest.raises(ParameterError):
        parse_markers(text)


def test_corners_are_found_to_a_twentieth_of_a_pixel():
    found = find_markers(MARKERS, warped(QUAD))
    assert list(found) == [7]
    assert np.abs(found[7] - QUAD).max() < 0.05


def test_quad_without_edges_is_returned_unchanged():
    flat = np.full((200, 200), 128, np.uint8)
    np.testing.assert_array_equal(refine_quad(flat, QUAD), QUAD)


def test_edges_that_move_inwards_move_the_corners_of_a_square_diagonally():
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    np.testing.assert_allclose(bloom_jacobian(square), [[1, 1], [-1, 1], [-1, -1], [1, -1]])
