# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.inspection.form import form_error

SIGMA = 10e-6


def plate(seed, wave=0.0):
    """A plate of 40 mm with noise, and a wave of the given form error along x."""
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 0.04, 2e-4), np.arange(0, 0.04, 2e-4)))
    z = 0.5 * wave * np.sin(2 * np.pi * x / 0.04)
    return np.stack([x, y, np.zeros(len(x))], axis=1), z + rng.normal(scale=SIGMA, size=len(x))


def test_noise_is_no_form_error():
    """The range of 40,000 vertices is 8 sigma of the noise."""
    for seed in range(5):
        points, residuals = plate(seed)
        found = form_error(points, residuals)
        assert np.ptp(residuals) > 7 * SIGMA
        assert found.value < 0.3 * SIGMA
        assert found.noise_u < 0.7 * SIGMA


@pytest.mark.parametrize('wave', [0.02e-3, 0.1e-3])
def test_form_error_is_found_within_its_uncertainty(wave):
    held = 0
    for seed in range(20):
        found = form_error(*plate(seed, wave))
        held += abs(found.value - wave) <= 2.0 * found.noise_u
    assert held >= 18


def test_few_patches_have_no_form_error():
    points, residuals = plate(0)
    few = np.flatnonzero((points[:, 0] < 3e-3) & (points[:, 1] < 3e-3))
    assert np.isnan(form_error(points[few], residuals[few]).value)
