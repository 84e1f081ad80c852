# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scales of residual plots show the residuals, however small these are."""

from matplotlib.figure import Figure
import numpy as np
import pytest

from ivfmc_ros.calibration.figure import _draw_means
from ivfmc_ros.calibration.figure import _draw_steps
from ivfmc_ros.calibration.figure import arrow_scale
from ivfmc_ros.simulation.bench import bench_cell


@pytest.mark.parametrize('largest', [1e-6, 0.003, 0.05, 0.4, 30.0])
def test_longest_arrow_is_seen_and_stays_in_its_field(largest):
    means = np.array([(0.0, 0.0), (0.6 * largest, -0.8 * largest)])
    scale = arrow_scale(means, 80.0)
    assert 30.0 < scale * largest <= 80.0
    assert f'{scale:.0e}'[0] in '125'


def test_no_error_has_no_arrow():
    assert arrow_scale(np.zeros((3, 2)), 80.0) == 0.0
    assert arrow_scale(np.empty((0, 2)), 80.0) == 0.0


@pytest.mark.parametrize('size', [0.004, 0.5])
def test_arrows_are_as_long_as_the_title_states(size):
    rng = np.random.default_rng(7)
    uv = rng.uniform(0, (1280, 1024), (4000, 2))
    residuals = np.tile((size, 0.0), (4000, 1))
    axes = Figure().subplots()
    scale = _draw_means(axes, bench_cell().camera, uv, residuals)
    lengths = [np.linalg.norm(np.subtract(text.xy, text.xyann)) for text in axes.texts]
    assert len(lengths) > 100
    assert np.allclose(lengths, scale * size)


@pytest.mark.parametrize('error', [0.002, 0.3])
def test_errors_of_the_table_fill_the_axis(error):
    """A step of 10 degrees that errs by 0.002 is a bar of its own, and not 0.02 % of one."""
    axes = Figure().subplots()
    _draw_steps(axes, np.array([10.0, 10.0, 10.0 + error, 10.0, 10.0 - error / 2]))
    heights = [bar.get_height() for bar in axes.patches]
    assert heights == pytest.approx([0, 0, error, 0, -error / 2], abs=1e-9)
    assert axes.get_ylim()[1] < 1.2 * error
    assert 'median step 10.000 degrees' in axes.get_title()
    assert 'degrees' in axes.get_ylabel()
