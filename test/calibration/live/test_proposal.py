# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.guide import ENOUGH
from ivfmc_ros.calibration.live.proposal import propose

BOARDS = ('chessboard:9x7:14mm', 'charuco:10x7:12mm:9mm:DICT_4X4_50')


def followed(guide, proposal):
    """The guide after a picture of the board as it was proposed."""
    uv = proposal.corners_uv * guide.size
    inside = (uv >= 0).all(axis=1) & (uv < guide.size).all(axis=1)
    found, reason = guide.add(Corners(ids=np.flatnonzero(inside), uv=uv[inside]))
    assert reason == '', proposal.text
    return found


@pytest.mark.parametrize('board', BOARDS)
@pytest.mark.parametrize('size', [(640, 480), (1280, 1024)])
def test_who_follows_the_proposals_has_a_complete_set(board, size):
    guide = CaptureGuide(parse_board(board), size)
    while (proposal := propose(guide)) is not None:
        assert proposal.text == guide.missing()[0]
        guide = followed(guide, proposal)
        # the last sentence counts down; the others are done by the picture
        assert proposal.text not in guide.missing()
        assert len(guide.views) <= ENOUGH + 5
    assert guide.is_complete


def test_board_is_drawn_within_the_image_where_the_text_says():
    guide = CaptureGuide(parse_board(BOARDS[1]), (1280, 1024))
    seen = {}
    while (proposal := propose(guide)) is not None:
        seen[proposal.text] = proposal.outline_uv
        guide = followed(guide, proposal)
    places = {text: uv.mean(axis=0) for text, uv in seen.items() if 'of the image' in text}
    assert len(places) == 4
    for text, (u, v) in places.items():
        column = ('left', 'middle', 'right')[int(3 * u)]
        row = ('upper', 'middle', 'lower')[int(3 * v)]
        assert text == f'hold the board in the {row} {column} of the image'
    for uv in seen.values():
        assert (np.ptp(uv, axis=0) > 0.15).all()


def test_tilted_board_is_larger_at_the_side_that_is_nearer():
    guide = CaptureGuide(parse_board(BOARDS[0]), (1280, 1024))
    proposal = propose(guide)
    assert 'right side towards the camera' in proposal.text
    upper_left, upper_right, lower_right, lower_left = proposal.outline_uv
    assert lower_right[1] - upper_right[1] > 1.1 * (lower_left[1] - upper_left[1])
