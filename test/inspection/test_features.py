# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.features import fit

R = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
T = np.array([0.1, -0.2, 0.3])


def points_of(kind, noise=0.0, count=500, share=1.0):
    rng = np.random.default_rng(4)
    angle = share * 2 * np.pi * rng.random(count)
    round_ = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    height = rng.uniform(-0.02, 0.02, count)
    if kind == 'plane':
        local = np.stack([rng.uniform(-0.03, 0.03, count), height, np.zeros(count)], axis=1)
        normal = np.tile([0.0, 0, 1], (count, 1))
    elif kind == 'sphere':
        normal = rng.normal(size=(count, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        local = 0.015 * normal
    else:
        normal, local = round_, 0.015 * round_
        if kind == 'cylinder':
            local = local + height[:, None] * [0, 0, 1]
    local = local + noise * rng.normal(size=(count, 1)) * normal
    return local @ R.T + T


@pytest.mark.parametrize('kind', ['cylinder', 'sphere', 'circle'])
@pytest.mark.parametrize('share', [1.0, 0.3])
def test_exact_points_give_the_exact_shape(kind, share):
    found = fit(kind, points_of(kind, share=share))
    assert found.diameter == pytest.approx(0.03, abs=1e-8)
    assert found.form < 1e-8
    if kind != 'sphere':
        assert abs(found.axis @ R[:, 2]) == pytest.approx(1.0, abs=1e-9)
    if kind != 'cylinder':
        assert found.center_xyz == pytest.approx(T, abs=1e-8)


def test_plane_has_no_diameter():
    found = fit('plane', points_of('plane'))
    assert np.isnan(found.diameter)
    assert abs(found.axis @ R[:, 2]) == pytest.approx(1.0)
    assert (found.center_xyz - T) @ R[:, 2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('kind', ['plane', 'cylinder', 'sphere', 'circle'])
def test_noise_shows_as_form_and_averages_out_of_the_size(kind):
    found = fit(kind, points_of(kind, noise=0.02e-3))
    assert found.rms == pytest.approx(0.02e-3, rel=0.15)
    assert 0.08e-3 < found.form < 0.2e-3
    if kind != 'plane':
        assert abs(found.diameter - 0.03) < 0.01e-3


@pytest.mark.parametrize(
    ('kind', 'problem'),
    [('cylinder', 'almost coplanar'), ('sphere', 'are coplanar')],
)
def test_flat_points_are_no_round_shape(kind, problem):
    with pytest.raises(GeometryError, match=problem):
        fit(kind, points_of('plane'))


def test_points_that_say_nothing_are_refused():
    with pytest.raises(GeometryError, match='needs at least 4 finite points, there are 3'):
        fit('sphere', np.eye(3))
    with pytest.raises(GeometryError, match='coincide'):
        fit('plane', np.ones((9, 3)))
    with pytest.raises(GeometryError, match='collinear'):
        fit('plane', np.outer(np.arange(9.0), np.ones(3)))
    with pytest.raises(ParameterError, match="feature: 'cone' is not one of"):
        fit('cone', np.ones((9, 3)))
