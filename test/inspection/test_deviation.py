# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection.deviation import summarize


def test_figures_are_those_of_the_distances():
    found = summarize(np.array([3e-3, -4e-3, 0.0, 1e-3]))
    assert found.count == 4
    assert found.rms == pytest.approx(np.sqrt(26 / 4) * 1e-3)
    assert found.worst == 4e-3
    assert found.mean == pytest.approx(0.0)


def test_ninety_five_percent_are_within():
    distances = np.linspace(-1.0, 1.0, 2001)
    assert summarize(distances).p95 == pytest.approx(0.95, abs=1e-3)


def test_mean_is_signed():
    assert summarize(np.full(10, -2e-5)).mean == pytest.approx(-2e-5)


def test_nothing_to_compare_is_refused():
    with pytest.raises(GeometryError, match='deviation: there are no points to compare'):
        summarize(np.empty(0))


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_distance_that_is_not_finite_is_refused(value):
    with pytest.raises(GeometryError, match='deviation: a distance is not finite'):
        summarize(np.array([1e-3, value]))
