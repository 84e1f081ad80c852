# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.form import form_error
from ivfmc_ros.inspection.form import roundness
from ivfmc_ros.inspection.form import straightness

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


def shaft(oval=0.0, barrel=0.0, seed=0):
    """A shaft of 20 mm with noise, an oval section and a barrel shape of the given form errors."""
    rng = np.random.default_rng(seed)
    angle, height = (
        a.ravel()
        for a in np.meshgrid(np.linspace(0, 2 * np.pi, 300), np.linspace(-0.015, 0.015, 150))
    )
    error = 0.5 * oval * np.cos(2 * angle) + barrel * (height / 0.015) ** 2
    radius = 0.01 + error + rng.normal(scale=SIGMA, size=len(angle))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return features.fit('cylinder', points, np.array([0.0, 0.0, 1.0])), points


def test_oval_is_out_of_round_and_straight():
    shape, points = shaft(oval=0.08e-3)
    assert roundness(shape, points).value == pytest.approx(0.08e-3, abs=12e-6)
    assert straightness(shape, points).value < 12e-6


def test_barrel_is_round_and_not_straight():
    shape, points = shaft(barrel=0.08e-3)
    assert straightness(shape, points).value == pytest.approx(0.08e-3, abs=15e-6)
    assert roundness(shape, points).value < 12e-6


def test_short_arc_has_no_roundness_and_short_band_no_straightness():
    shape, points = shaft()
    arc = points[points[:, 0] > 0.008]
    assert np.isnan(roundness(shape, arc).value)
    band = points[np.abs(points[:, 2]) < 0.004]
    assert np.isnan(straightness(shape, band).value)
    assert np.isfinite(roundness(shape, band).value)
