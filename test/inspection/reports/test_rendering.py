# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest
import trimesh

from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.reports.rendering import draw_cloud
from ivfmc_ros.inspection.reports.rendering import draw_mesh
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.inspection.reports.rendering import write_sheet
from ivfmc_ros.surface import Surface

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
VERTICES = np.asarray(BALL.vertices, dtype=np.float64)
FACES = np.asarray(BALL.faces, dtype=np.int64)
SIZE = (120, 90)
PAPER = (250, 250, 250)


def seen_from(azimuth=20.0, elevation=20.0):
    return Viewpoint.around(VERTICES, np.radians(azimuth), np.radians(elevation), SIZE)


def is_red(picture):
    blue, _, red = (picture[..., k].astype(int) for k in range(3))
    return red > blue + 40


def is_drawn(picture):
    return (picture != PAPER).any(axis=2)


@pytest.mark.parametrize('elevation', [20.0, 80.0, -30.0])
def test_outside_is_not_red(elevation):
    picture = draw_mesh(Surface(VERTICES, FACES), seen_from(elevation=elevation))
    assert picture.shape == (90, 120, 3)
    assert picture.dtype == np.uint8
    assert not is_red(picture).any()
    # a ball of 92 % of the height
    assert is_drawn(picture).sum() == pytest.approx(np.pi * (0.46 * 90) ** 2, rel=0.03)


def test_mesh_that_is_inside_out_is_red():
    picture = draw_mesh(Surface(VERTICES, FACES[:, ::-1]), seen_from())
    assert is_red(picture)[is_drawn(picture)].all()


def test_inside_of_an_open_mesh_is_red():
    open_below = FACES[VERTICES[FACES][:, :, 2].mean(axis=1) > 0.0]
    from_below = draw_mesh(Surface(VERTICES, open_below), seen_from(elevation=-80.0))
    assert is_red(from_below)[is_drawn(from_below)].mean() > 0.9


def test_axes_of_the_picture_are_right_and_up():
    # from azimuth 0 the eye is on +x: y goes to the right, z up
    view = Viewpoint.around(VERTICES, 0.0, 0.0, SIZE)
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01], [0.01, 0.0, 0.0]])
    column, row, height = view.pixels(points)
    assert (column[0], row[0]) == (60, 45)
    assert (column[1] > 60, row[1]) == (True, 45)
    assert (column[2], row[2] < 45) == (60, True)
    assert height == pytest.approx([0.0, 0.0, 0.0, 0.01])


def test_nearer_points_hide_farther_ones():
    view = Viewpoint.around(VERTICES, 0.0, 0.0, SIZE)
    near_last = np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]])
    values = np.array([0.0, 1.0])
    one = draw_cloud(near_last, values, view)
    other = draw_cloud(near_last[::-1], values[::-1], view)
    assert np.array_equal(one, other)
    assert is_drawn(one).sum() == 4


def test_points_outside_the_picture_do_no_harm():
    points = np.vstack([VERTICES, [[0.0, 5.0, 0.0], [0.0, 0.0, -5.0]]])
    picture = draw_cloud(points, points[:, 2], seen_from())
    assert is_drawn(picture).any()


def test_no_points_are_an_empty_picture():
    assert not is_drawn(draw_cloud(np.empty((0, 3)), np.empty(0), seen_from())).any()


def test_points_of_one_value_are_drawn():
    assert is_drawn(draw_cloud(VERTICES, np.full(len(VERTICES), 3.0), seen_from())).any()


def test_sheet_is_rows_of_pictures(tmp_path):
    tiles = [np.full((4, 5, 3), 10 * k, dtype=np.uint8) for k in range(6)]
    write_sheet(tmp_path / 'sheet.png', [tiles[:3], tiles[3:]])
    sheet = cv2.imread(str(tmp_path / 'sheet.png'))
    assert sheet.shape == (8, 15, 3)
    assert sheet[::4, ::5, 0].tolist() == [[0, 10, 20], [30, 40, 50]]


def test_sheet_in_a_missing_folder_is_refused(tmp_path):
    tile = np.zeros((4, 4, 3), dtype=np.uint8)
    with pytest.raises(FileError, match=r'none.sheet\.png: cannot be written'):
        write_sheet(tmp_path / 'none' / 'sheet.png', [[tile]])
