# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re

import numpy as np
import pytest

from ivfmc_ros.window.row_drawing import row_svg


def curve(html):
    points = re.search(r'polyline points="([^"]*)"', html)[1].split()
    return np.array([point.split(',') for point in points], dtype=float)


@pytest.mark.parametrize(('kind', 'full'), [(np.uint8, 255), (np.uint16, 65535)])
def test_gray_values_lie_between_zero_and_full_scale(kind, full):
    image = np.zeros((4, 300), dtype=kind)
    image[2, 150] = full
    html = row_svg(image, 2)
    assert f'highest {full} in column 150' in html
    y = curve(html)[:, 1]
    # 18 is the top of the diagram, 130 its floor
    assert (y.min(), y.max()) == (18.0, 130.0)
    assert curve(row_svg(image, 1))[:, 1].min() == 130.0


@pytest.mark.parametrize('width', [1, 2, 479, 640, 1281, 4096])
def test_single_bright_pixel_of_a_wide_image_is_not_lost(width):
    image = np.full((3, width, 3), 10, dtype=np.uint8)
    image[1, width - 1, 1] = 255
    points = curve(row_svg(image, 1))
    assert len(points) <= 480
    assert points[-1, 1] == 18.0
    assert points[:, 0].max() <= 394.0
