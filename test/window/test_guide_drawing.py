# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re
from types import SimpleNamespace

import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.proposal import propose
from ivfmc_ros.window.guide_drawing import picture_svg
from ivfmc_ros.window.guide_drawing import residual_svg
from ivfmc_ros.window.guide_drawing import volume_svg


@pytest.fixture
def guide():
    return CaptureGuide(parse_board('chessboard:9x7:14mm'), (640, 480))


def proposed(guide):
    """Corners of the board as the guide proposes it."""
    found = propose(guide)
    return Corners(ids=np.arange(len(found.corners_uv)), uv=found.corners_uv * guide.size)


def test_board_is_drawn_as_it_goes_next_and_named_for_a_screen_reader(guide):
    proposal = propose(guide)
    html = picture_svg(guide, proposal)
    assert f'no board detected; 0% of the image covered; next: {proposal.text}' in html
    points = re.search(r'polygon points="([^"]*)"', html)[1].split()
    drawn = np.array([point.split(',') for point in points], dtype=float)
    np.testing.assert_allclose(drawn, proposal.outline_uv * (640, 480), atol=0.5)


def test_fields_that_have_seen_corners_are_filled(guide):
    guide, _ = guide.add(proposed(guide))
    html = picture_svg(guide, None)
    assert html.count('#009e73') == round(9 * guide.coverage) > 0
    assert 'polygon' not in html


def test_detected_corners_are_drawn_on_the_picture(guide):
    corners = proposed(guide)
    html = picture_svg(guide, None, np.full((480, 640), 90, dtype=np.uint8), corners)
    assert html.count('<circle') == len(corners)
    assert f'{len(corners)} corners detected' in html
    assert 'data:image/jpeg;base64,' in html


def test_boards_are_drawn_from_above_at_their_distances(guide):
    assert volume_svg(guide) == ''
    while len(guide.views) < 8:
        guide, reason = guide.add(proposed(guide))
        assert not reason
    html = volume_svg(guide)
    lines = re.findall(r'M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)" stroke="#009e73"', html)
    assert len(lines) == 8
    ends = np.array(lines, dtype=float)
    assert ends.min() >= 0.0
    assert ends[:, (0, 2)].max() <= 400.0
    assert ends[:, (1, 3)].max() <= 190.0
    # depth is to the right: the ratio of the distances is that of the drawing
    depth = ends[:, (0, 2)].mean(axis=1) - 8.0
    distances = np.array([view.distance for view in guide.views])
    np.testing.assert_allclose(depth / depth[0], distances / distances[0], atol=0.01)
    assert f'{distances.max() / distances.min():.2f} times' in html


def test_scale_of_the_residuals_ends_at_the_largest():
    html = residual_svg(SimpleNamespace(view_rms=np.array([0.05, 0.1, 0.2]), rms=0.13))
    heights = [float(h) for h in re.findall(r'<rect [^>]*height="([\d.]+)"', html)]
    np.testing.assert_allclose(heights, max(heights) * np.array([0.25, 0.5, 1.0]), atol=0.1)
    assert '0.130 px rms; the worst picture 0.200 px' in html
    assert '>0.200</text>' in html
