# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.stripe.noise import SensorNoise


def test_variance_is_read_shot_and_speckle():
    noise = SensorNoise(read=2.0, electrons_per_dn=45.0, speckle=0.15)
    total, laser = np.array([0.0, 90.0, 106.0]), np.array([0.0, 0.0, 100.0])
    assert noise.variance(total, laser) == pytest.approx([4.0, 6.0, 4.0 + 106 / 45 + 225.0])


def test_value_below_black_adds_no_negative_variance():
    assert SensorNoise().variance(np.array([-50.0]), np.array([0.0]))[0] == 4.0
