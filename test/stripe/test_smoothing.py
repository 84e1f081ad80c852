# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.smoothing import smooth


def test_noise_falls_and_is_known():
    rng = np.random.default_rng(1)
    rows = np.arange(2000)
    sigma = rng.uniform(0.05, 0.2, len(rows))
    error = sigma * rng.standard_normal(len(rows))
    u, claimed = smooth(rows, 300.0 + error, sigma, 2.0)
    assert np.std(u - 300.0) < 0.4 * error.std()
    assert 0.9 < np.std((u - 300.0) / claimed) < 1.1


def test_slant_and_ends_are_not_moved():
    rows = np.arange(5, 60)
    truth = 400.0 + 2.5 * rows
    u, _ = smooth(rows, truth, np.full(len(rows), 0.1), 3.0)
    assert np.abs(u - truth).max() < 1e-6


def test_steps_and_gaps_stay_sharp():
    rows = np.concatenate([np.arange(30), np.arange(40, 70)])
    truth = np.where(np.arange(len(rows)) < 15, 100.0, 130.0)
    u, _ = smooth(rows, truth, np.full(len(rows), 0.1), 2.0)
    assert np.abs(u - truth).max() < 1e-6


def test_lonely_points_stay():
    rows = np.array([3, 50, 51, 90])
    u, sigma = smooth(rows, np.array([10.0, 20.0, 20.5, 80.0]), np.full(4, 0.1), 2.0)
    assert u[[0, 3]] == pytest.approx([10.0, 80.0])
    assert sigma == pytest.approx(np.full(4, 0.1), rel=0.05)


def test_width_out_of_range_is_refused():
    with pytest.raises(ParameterError, match=r'^along: -1\.0 is out of range'):
        ExtractSettings(along=-1.0)
