# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import ParameterError


def test_points_inside_and_outside_are_distinguished():
    volume = Volume(radius=0.05, bottom=0.001, top=0.1)
    points = np.array(
        [
            [0.0, 0.0, 0.05],
            [0.03, 0.0399, 0.001],
            [0.03, 0.0401, 0.05],
            [0.0, 0.0, 0.0009],
            [0.0, 0.0, 0.1001],
            [np.nan, 0.0, 0.05],
            [0.0, 0.0, np.nan],
        ]
    )
    expected = [True, True, False, False, False, False, False]
    assert volume.contains(points).tolist() == expected
    assert volume.contains(points[None]).shape == (1, 7)


@pytest.mark.parametrize('radius', [0.0, -0.1, 10.1, np.nan, np.inf])
def test_radius_out_of_range_is_refused(radius):
    with pytest.raises(ParameterError, match=r'radius: .* is out of range'):
        Volume(radius=radius)


@pytest.mark.parametrize(
    ('bottom', 'top'),
    [(0.1, 0.1), (0.1, 0.0), (-1.1, 0.0), (0.0, 11.0), (np.nan, 0.1), (0.0, np.nan)],
)
def test_heights_that_do_not_rise_are_refused(bottom, top):
    with pytest.raises(ParameterError, match=r'bottom, top: .* is no height range'):
        Volume(bottom=bottom, top=top)
