# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.erring_table import erring_cell
from support.erring_table import profiles_of
from support.erring_table import stripes
from support.erring_table import turns
from support.erring_table import views_of
from support.surfaces import empty
from support.synthetic import small_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.registration.self_calibration.parameters import CellParameters
from ivfmc_ros.registration.self_calibration.refine import refine
from ivfmc_ros.registration.solver.prior import CellPrior
from ivfmc_ros.registration.views.assemble import without
from ivfmc_ros.results import write_results
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface

CELL = small_cell()
PART = box((0.044, 0.030, 0.040)).moved(
    transforms.rigid(transforms.rotation_z(0.3), (0.006, -0.004, 0.0))
)
ERROR = np.radians(0.6)


@pytest.fixture(scope='module')
def scan():
    sweeps = turns(90, np.zeros_like)
    return sweeps, stripes(CELL, PART, sweeps, 1)


def reported(sweeps, order=1):
    """The table reports less than it turned by a periodic error."""
    return [
        replace(sweep, commanded=sweep.true - ERROR * np.cos(order * sweep.true))
        for sweep in sweeps
    ]


def rms(views):
    points = np.concatenate([view.cloud() for view in views])
    return np.sqrt(np.mean(Surface(PART.vertices_xyz, PART.faces).nearest(points).distance ** 2))


def test_angle_error_is_found_where_the_lasers_see_it(scan):
    sweeps, measured = scan
    views = views_of(CELL, measured, reported(sweeps))
    found = refine(CELL, views, ('angle',), prior=CellPrior(angle=ERROR, orders=2))
    known = {one.name: one for one in found.estimates}
    assert found.applied
    assert found.rms_after < 0.7 * found.rms_before
    assert known['angle cos 1'].observed
    assert abs(known['angle cos 1'].value - ERROR) < 3 * known['angle cos 1'].sigma
    assert abs(known['angle sin 1'].value) < 3 * known['angle sin 1'].sigma
    assert rms(found.views) < 0.7 * rms(views)
    assert found.cell is CELL  # the table angle is not part of cell.yaml


def test_wrong_axis_and_plane_are_corrected(scan):
    sweeps, measured = scan
    bad = erring_cell(CELL, np.random.default_rng(4), offset=3e-4, tilt=0.1, laser_tilt=0.1)
    views = views_of(bad, measured, sweeps)
    prior = CellPrior(axis_offset=3e-4, axis_tilt=2e-3, laser_tilt=2e-3, laser_offset=1e-4)
    found = refine(bad, views, ('axis', 'lasers'), prior=prior)
    assert found.applied
    assert rms(found.views) < 0.8 * rms(views)
    again = views_of(found.cell, measured, sweeps)
    assert np.nanmax(np.abs(again[0].points_xyz - found.views[0].points_xyz)) < 1e-9


def test_good_cell_is_confirmed(scan):
    sweeps, measured = scan
    views = views_of(CELL, measured, sweeps)
    found = refine(CELL, views, ('axis', 'angle', 'lasers'))
    assert not found.applied
    assert found.cell is CELL
    assert found.why.startswith('calibration')


def test_single_laser_in_a_single_sweep_is_not_checked(scan):
    sweeps, measured = scan
    (view,) = views_of(CELL, measured[:1], sweeps[:1])
    # a top face would be measured twice, in front of the axis and behind it
    top = view.points_xyz[..., 2] > 0.039
    found = refine(CELL, [without(view, top)], ('axis', 'angle'))
    assert found.why == 'not checked: no surface was measured twice'
    assert not any(one.observed for one in found.estimates)


def test_top_face_shows_a_single_laser_that_its_axis_leans(scan):
    sweeps, measured = scan
    lean = Rotation.from_rotvec([2e-3, 0.0, 0.0]).as_matrix()
    pose = CELL.turntable.camera_from_base @ transforms.rigid(lean, np.zeros(3))
    bad = replace(CELL, turntable=replace(CELL.turntable, camera_from_base=pose))
    found = refine(
        bad,
        views_of(bad, measured[:1], sweeps[:1]),
        ('axis',),
        prior=CellPrior(axis_tilt=2e-3, axis_offset=1e-6),
    )
    known = {one.name: one for one in found.estimates}
    assert found.applied
    across = np.array([known['axis tilt x'].value + 2e-3, known['axis tilt y'].value])
    # a lean along the sheet moves both passes alike
    sheet = np.array([np.cos(np.radians(36.0)), np.sin(np.radians(36.0))])
    seen = np.array([-sheet[1], sheet[0]])
    assert abs(across @ seen) < 2e-4
    assert found.rms_after < 0.3 * found.rms_before


def test_empty_views_are_not_checked(scan):
    sweeps, measured = scan
    views = [empty(view) for view in views_of(CELL, measured, sweeps)]
    assert refine(CELL, views, ('axis',)).why == 'not checked: no view has a surface'


def test_unknown_group_is_refused():
    with pytest.raises(ParameterError, match="refine: 'camera' is not one of poses, axis"):
        refine(CELL, [], ('camera',))


def test_views_of_another_cell_are_refused(scan):
    sweeps, measured = scan
    views = views_of(CELL, measured, sweeps)
    other = erring_cell(CELL, np.random.default_rng(1))
    with pytest.raises(GeometryError, match='refine with the cell that the scan was reconst'):
        refine(other, views, ('axis',))


def test_orders_that_no_table_needs_are_refused():
    with pytest.raises(ParameterError, match='prior: orders: 12 is out of range'):
        CellPrior(orders=12)


def test_prior_of_the_angle_is_shared_by_its_orders():
    prior = CellPrior(angle=2e-3, orders=5)
    parameters = CellParameters(cell=CELL, groups=frozenset({'angle'}), height=0.0, prior=prior)
    coefficients = parameters.sigma[:-1]
    assert len(coefficients) == 10
    at = parameters.angle_basis(np.array([0.3, 2.0]), 1.0)[:, :-1]
    np.testing.assert_allclose(np.sqrt((at**2) @ coefficients**2), 2e-3)


def test_pipeline_corrects_the_cell_and_writes_it(scan, tmp_path):
    sweeps, measured = scan
    bad = erring_cell(CELL, np.random.default_rng(4), offset=3e-4, tilt=0.1, laser_tilt=0.1)
    profiles = profiles_of(bad, measured, sweeps)
    made = reconstruct_profiles(
        bad, profiles, Settings(refine=('axis', 'lasers'), island_least=20)
    )
    assert made.refined is not None
    assert made.refined.applied
    document = write_results(tmp_path / 'result', bad, made, 'test', {})
    corrected = load_cell(tmp_path / 'result' / 'cell.yaml', CELL.camera)
    pose = made.refined.cell.turntable.camera_from_base
    assert np.allclose(corrected.turntable.camera_from_base, pose)
    assert document['refined']['misfit_m']['after'] < document['refined']['misfit_m']['before']
    assert len(document['refined']['unknowns']) == 10


def test_group_that_cannot_be_refined_is_refused_by_the_settings():
    with pytest.raises(ParameterError, match="refine: 'scale' is not one of"):
        Settings(refine=('scale',))
