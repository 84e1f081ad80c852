# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from support.synthetic import make_profile

from ivfmc_ros.stripe import denoise


def chain(*gaps_mm):
    """Points along x with these gaps."""
    x = np.concatenate([[0.0], np.cumsum(gaps_mm)]) * 1e-3
    return np.stack([x, 0 * x, 0 * x], axis=1)


def test_piece_that_is_too_small_is_noise():
    points = chain(0.3, 0.3, 0.3, 5.0, 0.3, 5.0, 0.3, 0.3, 0.3)
    kept = denoise.filter_by_neighbor_distance(points, 2e-3, least=3)
    assert kept.tolist() == [True] * 4 + [False] * 2 + [True] * 4


def test_least_is_enough():
    points = chain(0.3, 5.0, 0.3, 0.3)
    assert denoise.filter_by_neighbor_distance(points, 2e-3, least=2).all()
    assert (
        denoise.filter_by_neighbor_distance(points, 2e-3, least=3).tolist()
        == [False] * 2 + [True] * 3
    )
    assert not denoise.filter_by_neighbor_distance(points, 2e-3, least=4).any()


def test_threshold_divides():
    points = chain(1.9, 2.1, 1.9)
    assert not denoise.filter_by_neighbor_distance(points, 2e-3, least=3).any()
    assert denoise.filter_by_neighbor_distance(points, 2.2e-3, least=3).all()


def test_distance_is_measured_in_space():
    # 1.5 mm along each axis is 2.6 mm
    points = np.arange(5)[:, None] * np.full(3, 1.5e-3)
    assert not denoise.filter_by_neighbor_distance(points, 2e-3, least=2).any()


def test_single_point_is_noise():
    assert denoise.filter_by_neighbor_distance(chain(), 2e-3).tolist() == [False]


def test_empty_profile_stays_empty():
    profile = make_profile(np.empty((0, 3)))
    kept = denoise.filter_by_neighbor_distance(profile.points_xyz, 2e-3)
    assert kept.tolist() == []
    assert len(denoise.select_points(profile, kept)) == 0


def test_kept_points_keep_all_that_belongs_to_them():
    profile = make_profile(np.random.default_rng(1).normal(size=(6, 3)), angle=0.3, seq=7)
    chosen = np.array([True, False, True, False, False, True])
    kept = denoise.select_points(profile, chosen)
    for name in ('points_xyz', 'intensity', 'sigma', 'uv'):
        assert np.array_equal(getattr(kept, name), getattr(profile, name)[chosen])
    assert (kept.angle, kept.seq) == (0.3, 7)
