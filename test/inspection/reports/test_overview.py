# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.synthetic import make_profile
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.inspection.reports.overview import write_cloud_sheet
from ivfmc_ros.inspection.reports.overview import write_mesh_sheet
from ivfmc_ros.inspection.reports.overview import write_stripe_sheet
from ivfmc_ros.inspection.reports.rendering import BACK_BGR
from ivfmc_ros.inspection.reports.rendering import FRONT_BGR
from ivfmc_ros.inspection.reports.rendering import scale_bar
from ivfmc_ros.meshing.paper.range_mesh import range_mesh
from ivfmc_ros.model import Frame
from ivfmc_ros.registration.views.assemble import assemble


def sphere_mesh():
    cell, sphere = small_cell(), Sphere(np.array([0.0, 0.0, 0.04]), 0.02)
    (view,) = assemble(cell, sphere_profiles(cell, sphere, 40))
    return range_mesh(cell, view, 6e-3)


def red_share(path):
    picture = cv2.imread(str(path)).astype(int)
    drawn = (picture < 245).any(axis=2)
    return float((picture[..., 2] > picture[..., 0] + 40)[drawn].mean())


def test_mesh_that_is_inside_out_is_seen_at_once(tmp_path):
    mesh = sphere_mesh()
    write_mesh_sheet(tmp_path / 'right.png', mesh)
    write_mesh_sheet(tmp_path / 'wrong.png', replace(mesh, faces=mesh.faces[:, ::-1]))
    # the ring of a sphere is open above and below, so that some inside is seen
    assert red_share(tmp_path / 'right.png') < 0.35
    assert red_share(tmp_path / 'wrong.png') > 0.65
    assert cv2.imread(str(tmp_path / 'right.png')).shape == (1280 + 44, 2160, 3)


def test_cloud_is_drawn_from_six_sides(tmp_path):
    points = sphere_mesh().vertices_xyz
    write_cloud_sheet(tmp_path / 'cloud.png', points, points[:, 2])
    picture = cv2.imread(str(tmp_path / 'cloud.png'))
    assert picture.shape == (1280 + 44, 2160, 3)
    tiles = picture[:1280].reshape(2, 640, 3, 720, 3).swapaxes(1, 2).reshape(6, -1)
    assert ((tiles < 245).sum(axis=1) > 1000).all()


def test_every_view_of_a_mesh_has_a_scale_bar_of_the_length_it_states(tmp_path):
    mesh = sphere_mesh()
    write_mesh_sheet(tmp_path / 'mesh.png', mesh)
    picture = cv2.imread(str(tmp_path / 'mesh.png'))
    size = np.ptp(mesh.vertices_xyz, axis=0).max()
    for row in (640, 1280):
        for column in (0, 720, 1440):
            # the bar is a dark line at the bottom of its tile
            line = (picture[row - 18, column : column + 720] < 60).all(axis=1)
            length, pixels = scale_bar(0.46 * 640 / (0.5 * size), 720)
            assert line.sum() == pytest.approx(pixels, rel=0.2)
            assert length in (0.01, 0.02, 0.005)


@pytest.mark.parametrize(
    ('scale', 'width', 'length'), [(1000.0, 400, 0.1), (999.0, 400, 0.1), (3e4, 720, 5e-3)]
)
def test_scale_bar_is_a_round_length_of_at_most_a_quarter(scale, width, length):
    assert scale_bar(scale, width) == (pytest.approx(length), pytest.approx(length * scale))


def test_back_faces_are_in_the_legend(tmp_path):
    mesh = sphere_mesh()
    write_mesh_sheet(tmp_path / 'mesh.png', mesh)
    legend = cv2.imread(str(tmp_path / 'mesh.png'))[1280:]
    for color in (FRONT_BGR, BACK_BGR):
        assert (legend == color).all(axis=2).sum() > 300


@pytest.mark.parametrize('count', range(1, 13))
def test_sheet_of_stripes_has_no_empty_tile(tmp_path, count):
    frame = Frame(image=np.full((128, 160), 9, dtype=np.uint8), stamp_ns=0, angle=0.1)
    profile = make_profile(np.zeros((1, 3)), uv=np.array([[80.0, 64.0]]))
    write_stripe_sheet(tmp_path / 'stripe.png', [(frame, profile)] * count)
    picture = cv2.imread(str(tmp_path / 'stripe.png'))
    rows, columns = picture.shape[0] // 512, picture.shape[1] // 640
    assert rows * columns >= count - 1
    tiles = picture.reshape(rows, 512, columns, 640, 3).swapaxes(1, 2).reshape(-1, 512 * 640 * 3)
    assert (tiles == 9).mean(axis=1).min() > 0.5
