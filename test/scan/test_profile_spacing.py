# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from ivfmc_ros.scan.profile_spacing import greatest_radius
from ivfmc_ros.scan.profile_spacing import greatest_spacing
from ivfmc_ros.scan.profile_spacing import wide_ranges

PLACES = [(0.0, 0.01), (0.1, 0.01), (0.2, 0.03), (0.3, 0.03), (0.4, 0.0), (0.5, 0.0)]


def test_spacing_is_that_of_the_outer_neighbor():
    assert greatest_spacing(PLACES[:2]) == 0.1 * 0.01
    assert greatest_spacing(PLACES[1:3]) == 0.1 * 0.03
    assert greatest_spacing(PLACES[-2:]) == 0.0
    assert greatest_spacing([]) == 0.0


def test_only_neighbors_above_the_limit_are_wide():
    assert wide_ranges(PLACES, 2e-3) == [(0.1, 0.2), (0.2, 0.3), (0.3, 0.4)]
    assert wide_ranges(PLACES, 4e-3) == []


def test_radius_is_that_within_the_range():
    assert greatest_radius(PLACES, (0.0, 0.1)) == 0.01
    assert greatest_radius(PLACES, (0.1, 0.4)) == 0.03
    assert greatest_radius(PLACES, (0.6, 0.7)) == 0.0
