# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import make_profile

from ivfmc_ros.inspection.reports.stripe_pictures import MARK_BGR
from ivfmc_ros.inspection.reports.stripe_pictures import overlay
from ivfmc_ros.model import Frame


def marked(picture):
    return (np.abs(picture.astype(int) - MARK_BGR) < 25).all(axis=2)


def frame_of(shape=(1024, 1280), depth=8):
    return Frame(image=np.zeros(shape, dtype=f'uint{depth}'), stamp_ns=0, angle=0.1, seq=3)


def stripe(column):
    rows = np.arange(200.0, 800.0)
    return make_profile(
        np.zeros((len(rows), 3)), uv=np.stack([np.full(len(rows), column), rows], axis=1)
    )


@pytest.mark.parametrize('shape', [(1024, 1280), (1024, 1280, 3)])
@pytest.mark.parametrize('depth', [8, 16])
def test_stripe_is_marked_where_it_was_found_by_a_line_that_is_seen(shape, depth):
    picture = overlay(frame_of(shape, depth), stripe(400.5))
    assert picture.shape == (512, 640, 3)
    columns = np.flatnonzero(marked(picture[100:400]).sum(axis=0) > 250)
    # (0, 0) is the center of the first pixel in both pictures
    assert columns.mean() == pytest.approx(200.0, abs=0.01)
    assert 3 <= len(columns) <= 5


@pytest.mark.parametrize(('column', 'left'), [(300.0, False), (1000.0, True)])
def test_enlarged_part_shows_sub_pixel_positions_beside_the_stripe(column, left):
    one, other = (
        np.argwhere(marked(overlay(frame_of(), stripe(column + shift))[320:]))
        for shift in (0.0, 0.5)
    )
    beside = [spots[(spots[:, 1] < 320) == left] for spots in (one, other)]
    assert all(len(spots) > 300 for spots in beside)
    # half a pixel of the camera is four pixels of the enlarged part
    moved = beside[1][:, 1].mean() - beside[0][:, 1].mean()
    assert moved == pytest.approx(4.0, abs=0.3)


def test_picture_without_points_is_drawn():
    assert not marked(overlay(frame_of(), make_profile(np.empty((0, 3))))).any()
