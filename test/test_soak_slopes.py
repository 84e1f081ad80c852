# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The soak bench finds what a process keeps of each scan."""

import pytest

pytest.importorskip('rclpy')
from bench.bench_soak import Holdings
from bench.bench_soak import slopes


def figures(samples):
    names = dict.fromkeys(range(9), 'recorder')
    return {number.name.split()[0]: number for number in slopes(samples, names)}


def test_process_that_keeps_a_file_every_tenth_scan_is_found():
    samples = [
        {pid: Holdings(9e4, 30 + (scan // 10 if pid == 3 else 0), 12) for pid in range(9)}
        for scan in range(100)
    ]
    found = figures(samples)
    assert found['handles'].value == pytest.approx(0.1, abs=0.01)
    assert found['handles'].ok is False
    assert found['threads'].ok is True


def test_caches_of_the_first_scans_are_no_growth():
    samples = [
        {pid: Holdings(9e4 + 1e3 * min(scan, 20), 30, 12) for pid in range(9)}
        for scan in range(100)
    ]
    assert figures(samples)['memory'].ok is True


def test_process_that_was_started_again_is_missed():
    samples = [{pid: Holdings(9e4, 30, 12) for pid in range(9)} for _ in range(100)]
    samples[60].pop(8)
    assert figures(samples)['processes'].value == 8
    samples[60].pop(7)
    assert figures(samples)['processes'].ok is False
