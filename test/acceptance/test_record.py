# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from datetime import datetime
from datetime import timedelta
from datetime import UTC

import numpy as np
import pytest

from ivfmc_ros.acceptance.artifact import Artifact
from ivfmc_ros.acceptance.certificate import write_certificate
from ivfmc_ros.acceptance.check import Characteristic
from ivfmc_ros.acceptance.check import Check
from ivfmc_ros.acceptance.record import check_document
from ivfmc_ros.acceptance.record import write_record
from ivfmc_ros.acceptance.state import certificate_text
from ivfmc_ros.acceptance.state import check_state
from ivfmc_ros.acceptance.state import copy_record
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.errors import FileError
from ivfmc_ros.simulation.bench import bench_cell

MONTH = timedelta(days=30)


@pytest.fixture
def check():
    rng = np.random.default_rng(0)
    unit = rng.standard_normal((500, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    size = Characteristic(
        name='probing size error',
        symbol='PS (P_Size.Sph)',
        value=4e-6,
        limit=30e-6,
        u_test=1e-6,
        u_cell=3e-6,
        measured=0.025004,
        nominal=0.025,
    )
    form = Characteristic(
        name='probing form error', symbol='PF', value=4e-5, limit=6e-5, u_test=1e-6
    )
    return Check(
        artifact=Artifact(kind='sphere', diameter=0.025, u=1e-6),
        characteristics=(form, size),
        points_xyz=0.0125 * unit,
        deviations=1e-5 * rng.standard_normal(500),
        coverage=(0.8,),
    )


def identity(cell):
    return calibration_id(cell.turntable, cell.lasers)


def test_record_of_this_calibration_is_current(check, tmp_path):
    path = record_path(tmp_path / 'cell.yaml')
    assert path.name == 'cell.check.json'
    own = identity(bench_cell())
    assert check_state(path, own, MONTH).state == 'never'
    write_record(path, check_document(check, own, 'mesh.ply'))
    state = check_state(path, own, MONTH)
    assert state.is_current
    later = datetime.now(UTC) + timedelta(days=40)
    old = check_state(path, own, MONTH, later)
    assert old.state == 'too old'
    assert '40 days' in old.detail


def test_record_of_another_calibration_does_not_count(check, tmp_path):
    cell, path = bench_cell(), tmp_path / 'cell.check.json'
    write_record(path, check_document(check, identity(cell), 'mesh.ply'))
    plane = replace(cell.lasers[0], offset=cell.lasers[0].offset + 1e-6)
    other = identity(replace(cell, lasers=(plane, cell.lasers[1])))
    found = check_state(path, other, MONTH)
    assert found.state == 'other calibration'
    assert other in found.detail
    # names and residuals are no part of a calibration's identity
    renamed = replace(cell.lasers[0], residual_rms=1.0, name='left hand')
    assert identity(replace(cell, lasers=(renamed, cell.lasers[1]))) == identity(cell)


def test_failed_check_does_not_count(check, tmp_path):
    path, own = tmp_path / 'cell.check.json', identity(bench_cell())
    bad = replace(check.characteristics[0], value=1e-4)
    write_record(path, check_document(replace(check, characteristics=(bad,)), own, 'mesh.ply'))
    assert check_state(path, own, MONTH).state == 'failed'


def test_damaged_record_is_refused(tmp_path):
    path = tmp_path / 'cell.check.json'
    path.write_text('{"created": "yesterday"}')
    with pytest.raises(FileError, match='no record of a check'):
        check_state(path, 'x', MONTH)


def test_title_block_names_the_test_of_this_calibration_only(check, tmp_path):
    path, own = record_path(tmp_path / 'cell.yaml'), identity(bench_cell())
    assert certificate_text(path, own) == 'none: the cell was never checked'
    document = check_document(check, own, 'mesh.ply')
    write_record(path, {**document, 'created': '2026-11-20T09:00:00+00:00'})
    assert certificate_text(path, own) == f'pass on 2026-11-20, {check.artifact}, at 20 °C'
    assert certificate_text(path, 'abc') == 'none: the last check was of another calibration'
    path.write_text('{"created": "yesterday"}')
    assert certificate_text(path, own) == ''


def test_record_goes_with_a_copy_of_the_cell(check, tmp_path):
    cell_file, scan = tmp_path / 'bench.yaml', tmp_path / 'scan'
    scan.mkdir()
    copy_record(cell_file, scan)
    assert list(scan.iterdir()) == []
    write_record(record_path(cell_file), check_document(check, 'abc', 'mesh.ply'))
    copy_record(cell_file, scan)
    assert certificate_text(record_path(scan / 'cell.yaml'), 'abc').startswith('pass on ')


def test_exact_artifact_and_cell_have_no_normalized_error(check, tmp_path):
    exact = replace(check.characteristics[1], u_test=0.0, u_cell=0.0)
    document = check_document(replace(check, characteristics=(exact,)), 'abc', 'mesh.ply')
    assert document['characteristics'][0]['normalized_error'] is None
    write_record(tmp_path / 'check.json', document)


def test_certificate_says_the_figures(check, tmp_path):
    document = check_document(check, 'abc123', 'scan <1>')
    written = write_certificate(tmp_path, check, document)
    assert {path.name for path in written} == {
        'certificate.pdf',
        'certificate.png',
        'certificate.html',
    }
    page = (tmp_path / 'certificate.html').read_text()
    for part in ('abc123', 'scan &lt;1&gt;', 'probing size error', '+4.0', 'pass', 'ISO 14253-1'):
        assert part in page
    assert (tmp_path / 'certificate.pdf').read_bytes().startswith(b'%PDF')
