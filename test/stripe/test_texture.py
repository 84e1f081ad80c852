# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.texture import sample_colors

SPHERE = Sphere(np.array([0.01, 0.005, 0.04]), 0.02)
UV = np.array([[1.0, 0.0], [0.5, 1.0]])


def test_colors_are_red_green_blue_and_interpolated():
    picture = np.zeros((2, 3, 3), dtype=np.uint8)
    picture[0, 1] = (10, 20, 30)
    picture[1, 0] = (100, 0, 0)
    assert sample_colors(UV, picture).tolist() == [[30, 20, 10], [0, 0, 50]]


@pytest.mark.parametrize(('kind', 'white'), [(np.uint8, 255), (np.uint16, 65535)])
def test_mono_pictures_give_gray(kind, white):
    assert (sample_colors(UV, np.full((2, 3), white, dtype=kind)) == 255).all()


def test_no_point_has_no_color():
    assert sample_colors(np.zeros((0, 2)), np.zeros((4, 4), dtype=np.uint8)).shape == (0, 3)


def test_color_goes_with_the_points_into_the_view():
    cell = small_cell()
    acquisition = Acquisition(cell, AcquisitionSettings())
    texture = np.zeros((512, 640, 3), dtype=np.uint8)
    texture[:] = (50, 100, 200)
    frames = list(sphere_frames(cell, SPHERE, 4, seed=1))
    (view,) = assemble(cell, [acquisition.profile(frame, texture) for frame in frames])
    assert (view.color[view.valid] == (200, 100, 50)).all()
    assert not view.color[~view.valid].any()
    (plain,) = assemble(cell, [acquisition.profile(frame) for frame in frames])
    assert plain.color is None
