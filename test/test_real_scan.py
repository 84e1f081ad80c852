# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands that the documentation gives for a real scan, and what they must achieve."""

import json

import numpy as np
import pytest
from support.box_fit import fit_box
from support.real_scan import run_documented_commands
import trimesh

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def scanned(tmp_path_factory, data_dir):
    folder = tmp_path_factory.mktemp('real_scan')
    seconds = run_documented_commands(data_dir / 'turntable_laser', folder)
    return folder, seconds


def report(scanned, name):
    return json.loads((scanned[0] / name).read_text(encoding='utf-8'))


def test_calibrations_meet_their_bars(scanned):
    assert report(scanned, 'camera.report.json')['rms_px'] <= 0.20
    assert report(scanned, 'cell.laser.report.json')['residual_rms_m'] <= 0.30e-3
    assert report(scanned, 'cell.turntable.report.json')['platter_stripe_rms_m'] <= 0.45e-3


def test_reports_name_the_length_that_gives_the_scale(scanned):
    assert 'chessboard:8x6:40mm' in report(scanned, 'cell.laser.report.json')['scale']
    assert 'the laser' in report(scanned, 'cell.turntable.report.json')['scale']


def test_enough_of_the_part_is_kept(scanned):
    assert report(scanned, 'result/report.json')['counts']['kept_points'] >= 40_000
    assert all((scanned[0] / 'result' / f'{name}.png').is_file() for name in ('mesh', 'cloud'))


def test_the_block_is_a_box(scanned):
    mesh = trimesh.load(scanned[0] / 'result' / 'mesh.ply', process=False)
    box = fit_box(np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals), 5.0, 32.0)
    assert np.abs(box.corners - 90.0).max() <= 0.6
    assert box.skew.max() <= 1.0
    assert box.flatness.max() <= 0.30
