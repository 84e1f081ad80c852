# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan with a camera that the table triggers, from its profiles to mesh and code."""

from dataclasses import replace
import math

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.triggered import TriggeredSweep

from ivfmc_ros import pipeline
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.results import write_results

STEP = math.radians(2.0)
SPHERE = Sphere(np.array([0.008, -0.005, 0.04]), 0.025)
SETTINGS = pipeline.Settings(registration='table', island_least=20)
FREE = small_cell()
TRIGGERED = replace(FREE, turntable=replace(FREE.turntable, trigger_step=STEP))


def scan(**faults):
    """Return sweeps of both lasers, and their profiles at the reported angles."""
    sweeps = [
        TriggeredSweep(step=STEP, seed=laser, begin=1.0 + 40.0 * laser, **faults)
        for laser in (0, 1)
    ]
    profiles = []
    for laser, sweep in enumerate(sweeps):
        taken = sweep.profiles(view=laser, first_seq=1000 * laser)
        for profile, angle in zip(taken, sweep.true_angles(taken), strict=True):
            uv = SPHERE.stripe(FREE, angle, laser)
            points = FREE.lasers[laser].intersect(FREE.camera.rays(uv))
            count = len(uv)
            changes = {
                'points_xyz': FREE.turntable.to_part(points, profile.angle),
                'intensity': np.full(count, 100.0),
                'sigma': np.full(count, 1e-5),
            }
            profiles.append(replace(profile, uv=uv, laser=laser, **changes))
    return sweeps, profiles


def angle_errors(cell, sweeps, profiles):
    """Radians off the truth in both views, without the constant that turns the whole part."""
    views, _, _ = pipeline.assemble_views(cell, profiles, SETTINGS)
    by_seq = {profile.seq: profile for profile in profiles}
    off = [
        view.angles - sweeps[view.number].true_angles([by_seq[seq] for seq in view.seqs.tolist()])
        for view in views
    ]
    off = np.concatenate(off)
    return off - np.median(off)


def test_angles_of_a_triggered_scan_are_exact_and_those_of_the_fit_are_not():
    sweeps, profiles = scan()
    exact = angle_errors(TRIGGERED, sweeps, profiles)
    fitted = angle_errors(FREE, sweeps, profiles)
    assert np.abs(exact).max() < 1e-9
    assert np.sqrt(np.mean(fitted**2)) > 1e-5


def test_dropped_and_doubled_triggers_are_counted_in_report_and_code_stays_ok(tmp_path):
    _, profiles = scan(drop=0.05, double=0.05)
    made = pipeline.reconstruct_profiles(TRIGGERED, profiles, SETTINGS)
    document = write_results(tmp_path / 'result', TRIGGERED, made, 'scan', {})
    assert document['code'] == 'OK'
    for view in (0, 1):
        check = document['triggers'][view]
        assert check['view'] == view
        assert check['dropped'] == len(check['dropped_angles']) > 0
        assert f'view {view}: {check["dropped"]} steps without a picture' in made.table.triggers
    assert document['triggers'][0]['doubled'] > 0
    assert document['counts']['triggers'] > 0
    distance = SPHERE.distance(made.mesh.vertices_xyz)
    assert np.sqrt(np.mean(distance**2)) < 0.07e-3


@pytest.mark.parametrize(
    ('step', 'faults', 'reason'),
    [
        (STEP, {'lost': 0.25 * STEP}, 'disagree'),
        (1.3 * STEP, {}, 'not on a grid'),
        (1.02 * STEP, {}, 'trigger_step is 2.04'),
    ],
)
def test_uncertain_numbers_end_a_scan_that_is_to_be_merged(step, faults, reason):
    _, profiles = scan(**faults)
    cell = replace(FREE, turntable=replace(FREE.turntable, trigger_step=step))
    with pytest.raises(GeometryError, match=reason):
        pipeline.register_clamping('scan', cell, profiles, SETTINGS)
