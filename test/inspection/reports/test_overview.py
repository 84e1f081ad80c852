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
    assert cv2.imread(str(tmp_path / 'right.png')).shape == (1280, 2160, 3)


def test_cloud_is_drawn_from_six_sides(tmp_path):
    points = sphere_mesh().vertices_xyz
    write_cloud_sheet(tmp_path / 'cloud.png', points, points[:, 2])
    picture = cv2.imread(str(tmp_path / 'cloud.png'))
    assert picture.shape == (1280, 2160, 3)
    tiles = picture.reshape(2, 640, 3, 720, 3).swapaxes(1, 2).reshape(6, -1)
    assert ((tiles < 245).sum(axis=1) > 1000).all()


@pytest.mark.parametrize('shape', [(512, 640), (512, 640, 3)])
@pytest.mark.parametrize('depth', [8, 16])
def test_stripe_points_are_drawn_where_they_were_found(tmp_path, shape, depth):
    frame = Frame(image=np.zeros(shape, dtype=f'uint{depth}'), stamp_ns=0, angle=0.1, seq=3)
    uv = np.array([[300.4, 100.0], [301.2, 101.0]])
    profile = make_profile(np.zeros((2, 3)), uv=uv)
    write_stripe_sheet(tmp_path / 'stripe.png', [(frame, profile)] * 5)
    picture = cv2.imread(str(tmp_path / 'stripe.png'))
    assert picture.shape == (2 * 512, 4 * 640, 3)
    for row, column in ((0, 0), (0, 1920), (512, 0)):
        tile = picture[row : row + 512, column : column + 640]
        assert np.argwhere((tile == (0, 0, 255)).all(axis=2)).tolist() == [[100, 300], [101, 301]]
    # what is left over is white
    assert (picture[512:, 640:] == 255).all()


def test_picture_without_points_is_drawn(tmp_path):
    frame = Frame(image=np.zeros((512, 640), dtype=np.uint8), stamp_ns=0, angle=0.0)
    write_stripe_sheet(tmp_path / 'stripe.png', [(frame, make_profile(np.empty((0, 3))))])
    assert (tmp_path / 'stripe.png').stat().st_size > 0
