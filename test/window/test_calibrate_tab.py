# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re

import numpy as np

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.proposal import propose
from ivfmc_ros.window.calibrate_tab import guide_svg


def test_board_is_drawn_as_it_goes_next_and_named_for_a_screen_reader():
    guide = CaptureGuide(parse_board('chessboard:9x7:14mm'), (640, 480))
    proposal = propose(guide)
    html = guide_svg(guide, proposal)
    assert f'0% of the image covered; next: {proposal.text}' in html
    points = re.search(r'polygon points="([^"]*)"', html)[1].split()
    drawn = np.array([point.split(',') for point in points], dtype=float)
    np.testing.assert_allclose(drawn, proposal.outline_uv * (640, 480), atol=0.5)


def test_fields_that_have_seen_corners_are_filled():
    guide = CaptureGuide(parse_board('chessboard:9x7:14mm'), (640, 480))
    first = propose(guide)
    corners = Corners(ids=np.arange(len(first.corners_uv)), uv=first.corners_uv * guide.size)
    guide, _ = guide.add(corners)
    html = guide_svg(guide, None)
    assert html.count('#009e73') == round(9 * guide.coverage) > 0
    assert 'polygon' not in html
