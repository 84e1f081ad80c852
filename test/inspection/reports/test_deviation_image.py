# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a mesh colored by its deviation."""

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.deviation_image import deviation_colors
from ivfmc_ros.inspection.reports.deviation_image import write_deviation_image
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface


def red_minus_blue(image):
    """Mean over the pixels of the part in the first view."""
    tile = image[:, :520].astype(float)
    part = tile.min(axis=2) < 240
    return (tile[..., 2] - tile[..., 0])[part].mean()


def test_colors_are_blue_inside_gray_at_zero_and_red_outside():
    inside, zero, outside = deviation_colors(np.array([-1.0, 0.0, 1.0]), 0.5)
    assert inside[0] > inside[2]
    assert zero[0] == zero[1] == zero[2]
    assert outside[2] > outside[0]


def test_a_larger_part_is_red_a_smaller_one_blue_and_a_right_one_gray(tmp_path):
    nominal = box((0.02, 0.02, 0.02))
    closed = Surface(nominal.vertices_xyz, nominal.faces)
    tones = []
    for size in (0.0202, 0.02, 0.0198):
        part = box((size, size, size))
        path = tmp_path / f'{size}.png'
        surface = Surface(part.vertices_xyz, part.faces)
        write_deviation_image(path, surface, part.vertices_xyz, closed, 1e-4)
        tones.append(red_minus_blue(cv2.imread(str(path))))
    assert tones[0] > 50.0
    assert abs(tones[1]) < 25.0
    assert tones[2] < -50.0
