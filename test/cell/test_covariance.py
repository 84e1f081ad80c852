# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import parameter_names
from ivfmc_ros.cell.covariance import point_jacobian
from ivfmc_ros.cell.deviation import deviated
from ivfmc_ros.cell.deviation import independent_deviations
from ivfmc_ros.errors import CellError
from ivfmc_ros.simulation.bench import bench_cell


def covariance_of(cell, seed=0):
    names = parameter_names(cell.camera, [laser.name for laser in cell.lasers])
    rng = np.random.default_rng(seed)
    size = np.array([0.3 if name in ('fx', 'fy', 'cx', 'cy') else 1e-5 for name in names])
    root = size[:, None] * rng.standard_normal((len(names), len(names)))
    return CellCovariance(parameters=names, matrix=root @ root.T, scale_u=2e-4)


@pytest.fixture
def cell():
    bare = bench_cell()
    return replace(bare, covariance=covariance_of(bare))


def test_covariance_survives_the_file(cell, tmp_path):
    save_cell(tmp_path / 'cell.yaml', cell)
    found = load_cell(tmp_path / 'cell.yaml', cell.camera).covariance
    assert found.parameters == cell.covariance.parameters
    np.testing.assert_allclose(found.matrix, cell.covariance.matrix)
    assert found.scale_u == 2e-4


def test_covariance_of_a_camera_survives_the_file(cell, tmp_path):
    matrix = cell.covariance.matrix[:9, :9]
    save_camera(tmp_path / 'camera.yaml', replace(cell.camera, covariance=matrix))
    np.testing.assert_allclose(load_camera(tmp_path / 'camera.yaml').covariance, matrix)


def test_covariance_ends_with_another_laser(cell, tmp_path):
    save_cell(tmp_path / 'cell.yaml', cell)
    draft = load_draft(tmp_path / 'cell.yaml')
    assert draft.covariance is not None
    assert draft.with_laser(cell.lasers[0]).covariance is None
    assert draft.with_turntable(cell.turntable).covariance is None


def test_covariance_of_other_lasers_is_refused(cell):
    with pytest.raises(CellError, match='covariance: parameters'):
        replace(cell, lasers=cell.lasers[:1])


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda m: m[:3], 'finite numbers'),
        (lambda m: m + np.triu(np.full_like(m, np.abs(m).max()), 1), 'symmetric'),
        (lambda m: -m, 'semidefinite'),
    ],
)
def test_impossible_covariances_are_refused(cell, change, text):
    with pytest.raises(CellError, match=text):
        replace(cell.covariance, matrix=change(cell.covariance.matrix))


def test_file_with_an_unknown_key_is_refused(cell, tmp_path):
    save_cell(tmp_path / 'cell.yaml', cell)
    text = (tmp_path / 'cell.yaml').read_text().replace('scale_u', 'scale_v')
    (tmp_path / 'cell.yaml').write_text(text)
    with pytest.raises(CellError, match=r'cell\.yaml: covariance.*scale_v'):
        load_draft(tmp_path / 'cell.yaml')


def test_independent_deviations_make_up_the_covariance(cell):
    total = np.zeros_like(cell.covariance.matrix)
    for _, deviation in independent_deviations(cell.covariance):
        total += np.outer(deviation, deviation)
    sigma = np.sqrt(np.diag(total))
    np.testing.assert_allclose(
        total / np.outer(sigma, sigma),
        cell.covariance.matrix / np.outer(sigma, sigma),
        atol=1e-6,
    )


def test_errors_of_known_camera_leave_the_camera_alone(cell):
    for source, deviation in independent_deviations(cell.covariance):
        if source != 'camera':
            assert np.abs(deviation[:9]).max() < 1e-9
        if source == 'table axis':
            assert np.abs(deviation[:17]).max() < 1e-9


def test_point_jacobian_is_the_derivative_of_triangulated_points(cell):
    uv = np.array([[500.0, 300.0], [640.0, 511.0], [820.0, 800.0]])
    laser, angle = cell.lasers[0], 0.7

    def points(other):
        plane = other.lasers[0].intersect(other.camera.rays(uv))
        return other.turntable.to_part(plane, angle)

    J = point_jacobian(
        cell.camera,
        (laser.normal, laser.offset),
        cell.turntable.camera_from_base,
        uv,
        angle,
    )
    columns = [*range(9), *range(9, 13), *range(17, 23)]
    for place, column in enumerate(columns):
        # a change along the normal is no change of a unit normal: only across it
        step = np.zeros(23)
        step[column] = 1e-2 if column < 4 else 1e-6
        if 9 <= column < 12:
            step[9:12] -= laser.normal * (laser.normal @ step[9:12])
        expected = np.zeros((3, 3))
        for other, size in enumerate(columns):
            expected += J[:, :, other] * step[size]
        numeric = (points(deviated(cell, step)) - points(deviated(cell, -step))) / 2
        np.testing.assert_allclose(numeric, expected, atol=1e-4 * np.abs(expected).max() + 1e-13)
        assert place < J.shape[2]
