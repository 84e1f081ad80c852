# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from ivfmc_ros.devices.cameras.clock_fit import ClockFit

MS = 1_000_000


def errors(drift=0.0, frames=600, period_ms=66, jitter_ms=20.0, least_ms=2.0):
    """Errors of steady times, ms, with delays between least and least + jitter."""
    rng = np.random.default_rng(1)
    fit, found = ClockFit(), []
    for number in range(frames):
        true_ns = 5_000 * MS + number * period_ms * MS
        camera_ns = round((true_ns - 5_000 * MS) * (1 + drift)) + 77
        delay_ns = round((least_ms + rng.exponential(jitter_ms)) * MS)
        found.append((fit.to_steady(camera_ns, true_ns + delay_ns) - true_ns) / MS)
    return np.array(found)


def test_stamps_have_the_least_delay_not_that_of_each_image():
    # the delays themselves differ by more than 100 ms
    late = errors()[100:]
    assert late.min() > 1.0
    assert late.max() < 4.0


def test_drift_of_the_clock_is_followed():
    assert np.abs(errors(drift=1e-4)[200:] - 2.0).max() < 2.0


def test_camera_that_starts_again_begins_a_new_fit():
    fit = ClockFit()
    assert fit.to_steady(1_000, 5_000) == 5_000
    assert fit.to_steady(10, 9_000) == 9_000
