# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.acceptance.artifact import parse_artifact
from ivfmc_ros.acceptance.check import check_artifact
from ivfmc_ros.acceptance.check import dispersion
from ivfmc_ros.acceptance.check import form_error
from ivfmc_ros.acceptance.check import Limits
from ivfmc_ros.acceptance.points import MeasuredPoints
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import parameter_names
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.simulation.bench import bench_cell

NOISE = 5e-6  # meters, of a vertex


def sphere_points(center, radius, seed=0, lowest=-0.7, count=4000, sector=2 * np.pi):
    """Points and normals of a sphere without its lower part, as a turntable sees it."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(lowest, 1.0, count)
    turn = rng.uniform(0, sector, count)
    ring = np.sqrt(1 - z * z)
    unit = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    off = NOISE * rng.standard_normal(count)
    return np.asarray(center) + (radius + off)[:, None] * unit, unit


def plane_points(seed=0, size=0.06, height=0.02, bend=0.0, count=6000, center=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-size / 2, size / 2, (count, 2))
    z = height + bend * xy[:, 0] ** 2 + NOISE * rng.standard_normal(count)
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    return np.column_stack([xy + center, z]), normals


def joined(*parts, systematic=None):
    points = np.concatenate([p for p, _ in parts])
    return MeasuredPoints(
        points_xyz=points,
        normals=np.concatenate([n for _, n in parts]),
        systematic=None if systematic is None else np.full(len(points), systematic),
    )


@pytest.fixture
def ball_bar():
    return joined(
        sphere_points((-0.05, 0.0, 0.03), 0.010, seed=1),
        sphere_points((0.05, 0.0, 0.03), 0.010, seed=2),
        # the bar between the spheres, and the platter
        plane_points(seed=3, size=0.03, height=0.03, count=500),
        plane_points(seed=4, size=0.12, height=0.0, count=8000),
    )


def by_symbol(check, symbol):
    return [one for one in check.characteristics if one.symbol.startswith(symbol)]


def test_ball_bar_passes(ball_bar):
    artifact = parse_artifact('ball_bar:20mm:100mm', u=0.5e-6)
    check = check_artifact(artifact, ball_bar)
    assert check.verdict == 'pass'
    assert abs(by_symbol(check, 'SD')[0].value) < 2e-6
    assert len(by_symbol(check, 'PF')) == len(by_symbol(check, 'PS')) == 2
    for form in by_symbol(check, 'PF'):
        assert 4 * NOISE < form.value < 9 * NOISE
    assert all(share > 0.7 for share in check.coverage)


def test_wrong_distance_fails(ball_bar):
    check = check_artifact(parse_artifact('ball_bar:20mm:100.05mm'), ball_bar)
    assert check.verdict == 'fail'
    assert by_symbol(check, 'SD')[0].value == pytest.approx(-50e-6, abs=2e-6)


def test_uncertain_artifact_decides_nothing(ball_bar):
    check = check_artifact(parse_artifact('ball_bar:20mm:100.025mm', u=10e-6), ball_bar)
    assert by_symbol(check, 'SD')[0].verdict == 'not decided'
    assert check.verdict in ('not decided', 'fail')


def test_warm_artifact_is_longer(ball_bar):
    warm = Conditions(temperature=30.0, temperature_u=0.5)
    check = check_artifact(parse_artifact('ball_bar:20mm:100mm'), ball_bar, conditions=warm)
    distance = by_symbol(check, 'SD')[0]
    assert distance.value == pytest.approx(-11.5e-6, abs=2e-6)
    assert distance.u_test > 0.5e-6


def test_covariance_of_the_cell_states_an_uncertainty(ball_bar):
    cell = bench_cell()
    names = parameter_names(cell.camera, [laser.name for laser in cell.lasers])
    variance = np.array([0.2**2 if name in ('fx', 'fy') else 1e-16 for name in names])
    covariance = CellCovariance(parameters=names, matrix=np.diag(variance), scale_u=2e-4)
    known = replace(cell, covariance=covariance)
    artifact = parse_artifact('ball_bar:20mm:100mm', u=0.5e-6)
    distance = by_symbol(check_artifact(artifact, ball_bar, cell=known), 'SD')[0]
    assert distance.u_cell > 2e-4 * 0.1 * 0.99
    assert distance.normalized_error < 1.0
    unknown = by_symbol(check_artifact(artifact, ball_bar, cell=cell), 'SD')[0]
    assert unknown.u_cell is None
    assert unknown.normalized_error is None


def test_two_spheres_where_one_was_named_are_refused(ball_bar):
    with pytest.raises(GeometryError, match=r'has 1 sphere.*the scan 2: at \(-50'):
        check_artifact(parse_artifact('sphere:20mm'), ball_bar)


def test_half_hidden_sphere_is_refused():
    points = joined(sphere_points((0.0, 0.0, 0.02), 0.0125, sector=0.8 * np.pi))
    with pytest.raises(GeometryError, match=r'sphere 1 at .* half hidden: 3\d%'):
        check_artifact(parse_artifact('sphere:25mm'), points)


@pytest.mark.parametrize('text', ['sphere:25m', 'sphere:0.984252mm'])
def test_diameter_in_the_wrong_unit_is_named(text):
    points = joined(sphere_points((0.0, 0.0, 0.02), 0.0125))
    if text.endswith('5m'):
        with pytest.raises(ParameterError, match='diameter'):
            parse_artifact(text)
    else:
        with pytest.raises(GeometryError, match=r'wrong unit .inch given as mm'):
            check_artifact(parse_artifact(text), points)


def test_missing_sphere_is_refused():
    with pytest.raises(GeometryError, match='0 of 1 spheres'):
        check_artifact(parse_artifact('sphere:25mm'), joined(plane_points()))


def test_flat_plate_passes():
    check = check_artifact(parse_artifact('plate'), joined(plane_points()))
    assert check.verdict == 'pass'
    assert 4 * NOISE < check.characteristics[0].value < 9 * NOISE


def test_bent_plate_is_refused():
    with pytest.raises(GeometryError, match='not flat'):
        check_artifact(parse_artifact('plate'), joined(plane_points(bend=0.3)))


def test_gauge_step_is_measured():
    low = plane_points(seed=1, size=0.06, height=0.02, center=(-0.03, 0.0))
    high = plane_points(seed=2, size=0.04, height=0.03002, center=(0.03, 0.0))
    check = check_artifact(parse_artifact('gauge_step:10mm', u=1e-7), joined(low, high))
    step = check.characteristics[0]
    assert step.value == pytest.approx(20e-6, abs=2e-6)
    assert step.verdict == 'pass'
    with pytest.raises(GeometryError, match='no plane 25 mm beside'):
        check_artifact(parse_artifact('gauge_step:25mm'), joined(low, high))


def test_form_error_leaves_out_three_per_mille():
    values = np.concatenate([np.linspace(-1e-5, 1e-5, 997), [1e-3, -1e-3, 2e-3]])
    assert form_error(values) == pytest.approx(2e-5)


@pytest.mark.parametrize(
    'text', ['cube:3mm', 'sphere', 'ball_bar:20mm', 'sphere:wide', 'plate:1mm']
)
def test_artifacts_that_are_not_understood_are_refused(text):
    with pytest.raises(ParameterError, match='artifact'):
        parse_artifact(text)


def test_dispersion_holds_95_percent_in_the_narrowest_shell():
    values = np.concatenate([np.linspace(0.0, 1e-5, 950), np.linspace(5e-5, 9e-5, 50)])
    assert dispersion(np.random.default_rng(0).permutation(values)) == pytest.approx(1e-5)


@pytest.mark.parametrize('systematic', [8e-6, np.nan])
def test_error_that_all_points_share_is_in_the_stated_size(systematic):
    cell = bench_cell()
    names = parameter_names(cell.camera, [laser.name for laser in cell.lasers])
    covariance = CellCovariance(parameters=names, matrix=1e-16 * np.eye(len(names)), scale_u=0.0)
    points = joined(sphere_points((0.0, 0.0, 0.02), 0.0125), systematic=systematic)
    check = check_artifact(
        parse_artifact('sphere:25mm'), points, cell=replace(cell, covariance=covariance)
    )
    (size,) = by_symbol(check, 'PS')
    if np.isnan(systematic):
        assert size.u_cell is None
    else:
        assert size.u_cell == pytest.approx(16e-6, rel=0.05)


@pytest.mark.parametrize(
    ('artifact', 'limit'), [('sphere:20mm', 1e-5), ('plate', 2e-5), ('gauge_step:5mm', 3e-5)]
)
def test_points_are_chosen_by_the_limit_of_the_artifact(artifact, limit):
    limits = Limits(form=1e-5, flatness=2e-5, step=3e-5)
    assert limits.max_u(parse_artifact(artifact)) == limit


def test_limits_are_positive():
    with pytest.raises(ParameterError, match='limit: form'):
        Limits(form=0.0)
