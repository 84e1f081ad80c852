# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.feature_fit import ErringPoints
from ivfmc_ros.inspection.feature_fit import fit_feature
from ivfmc_ros.inspection.feature_fit import split_groups
from ivfmc_ros.inspection.uncertainty import CalibrationModes

RADIUS = 0.015
SIGMA = 0.02e-3


def diameter(points):
    return features.fit('cylinder', points).diameter


def jackknife(points, kind='cylinder', systematic=0.0):
    zero = np.zeros(len(points))
    outward = points * (1.0, 1.0, 0.0)
    erring = ErringPoints(
        points_xyz=points,
        normals=outward / np.linalg.norm(outward, axis=1, keepdims=True),
        systematic=zero + systematic,
        modes=CalibrationModes(shifts=np.zeros((0, len(points), 3))),
    )
    fitted = fit_feature(kind, erring, None, fixed=False)
    return fitted.budget(lambda shape: shape.diameter)


def wall(rng, share, smooth):
    """A part of a cylinder whose error is the same over patches of some millimeters."""
    angle, height = np.meshgrid(
        np.linspace(0, 2 * np.pi * share, 120, endpoint=False), np.linspace(0, 0.02, 20)
    )
    error = rng.normal(size=(20 // smooth, 120 // smooth)) * SIGMA
    error = np.kron(error, np.ones((smooth, smooth)))
    r = RADIUS + error
    return np.stack([r * np.cos(angle), r * np.sin(angle), height], axis=2).reshape(-1, 3)


@pytest.mark.slow
@pytest.mark.parametrize(('share', 'smooth'), [(1.0, 1), (1.0, 5), (0.4, 1), (0.4, 5)])
def test_diameter_is_as_far_off_as_is_said(share, smooth):
    rng = np.random.default_rng(3)
    scans = [wall(rng, share, smooth) for _ in range(40)]
    off = np.array([diameter(scan) for scan in scans]) - 2 * RADIUS
    said = np.array([jackknife(scan).components['noise'] for scan in scans])
    assert 0.8 < np.sqrt(np.mean(said**2)) / off.std() < 1.8
    assert (np.abs(off) < 1.96 * said).mean() >= 0.85


def test_patches_are_of_one_size_and_compact():
    points = np.random.default_rng(0).uniform(size=(1000, 3)) * (4.0, 1.0, 1.0)
    patch = split_groups(points, 3)
    assert np.bincount(patch).tolist() == [125] * 8
    extents = [np.ptp(points[patch == k], axis=0).max() for k in range(8)]
    assert max(extents) < 1.2


def test_patch_that_is_needed_is_refused():
    line = np.zeros((40, 3))
    line[:, 0] = np.arange(40.0)
    with pytest.raises(GeometryError, match='collinear'):
        jackknife(line, 'circle')


def test_systematic_error_does_not_average_out():
    """10 um on every point of a wall are 20 um of its diameter, however many points there are."""
    points = wall(np.random.default_rng(4), 1.0, 1)
    few, many = jackknife(points[::7], systematic=10e-6), jackknife(points, systematic=10e-6)
    for budget in (few, many):
        assert budget.components['stripe bias'] == pytest.approx(20e-6, rel=0.02)
        assert budget.standard == pytest.approx(
            np.hypot(budget.components['noise'], budget.components['stripe bias'])
        )
