# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from ivfmc_ros.scan.angle_ranges import joined


def test_nearest_ranges_are_joined():
    ranges = [(0.0, 0.1), (0.5, 0.6), (0.7, 0.8), (3.0, 3.1)]
    assert joined(ranges, 4) == ranges
    assert joined(ranges, 3) == [(0.0, 0.1), (0.5, 0.8), (3.0, 3.1)]
    assert joined(ranges, 2) == [(0.0, 0.8), (3.0, 3.1)]
    assert joined(ranges, 1) == [(0.0, 3.1)]
    assert joined([], 1) == []
