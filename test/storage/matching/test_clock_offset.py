# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.storage.matching.clock_offset import clock_text
from ivfmc_ros.storage.matching.clock_offset import clocks_differ


@pytest.mark.parametrize('ahead_s', [0.0, 1.9, -1.9])
def test_delay_of_a_network_is_no_other_clock(ahead_s):
    assert not clocks_differ(ahead_s)


@pytest.mark.parametrize(
    ('ahead_s', 'said'),
    [
        (3600.0, '3600.0 s ahead of those of the table; synchronize the clocks'),
        (-6.0, '6.0 s behind those of the table; synchronize the clocks'),
        (36.9, 'has TAI, the time of PTP, and not UTC'),
        (-37.2, 'has TAI, the time of PTP, and not UTC'),
    ],
)
def test_clocks_that_differ_are_said_with_the_likely_cause(ahead_s, said):
    assert clocks_differ(ahead_s)
    assert said in clock_text(ahead_s)
