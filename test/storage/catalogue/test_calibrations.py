# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a scan and its acceptance tests, from the files in the folder of the scan."""

from dataclasses import replace
import hashlib
import json

import pytest
import sqlalchemy as sql
from support.recordings import write_profiles
from support.synthetic import small_cell

from ivfmc_ros.acceptance.state import copy_record
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.catalogue.calibrations import add_calibration
from ivfmc_ros.storage.catalogue.calibrations import certificates
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.schema import CALIBRATIONS
from ivfmc_ros.storage.catalogue.search import ScanFilter

CELL = small_cell()
IDENTITY = calibration_id(CELL.turntable, CELL.lasers)


def record(created='2026-11-20T10:00:00+00:00', calibration=IDENTITY, verdict='pass'):
    return {'created': created, 'calibration': calibration, 'verdict': verdict, 'points': 5}


@pytest.fixture
def root(tmp_path):
    """Folder of two scans with one calibration, and the catalogue of them."""
    folder = tmp_path / 'scans'
    catalogue = Catalogue(folder, create=True)
    save_cell(tmp_path / 'cell.yaml', CELL)
    for name in ('s1', 's2'):
        catalogue.add_scan(name, 'bracket', '', 'DONE', {})
        write_profiles(folder / name, range(3), per_chunk=3)
        (folder / name / 'cell.yaml').write_bytes((tmp_path / 'cell.yaml').read_bytes())
    catalogue.close()
    return folder


def test_scans_of_one_calibration_share_its_row_and_are_found_by_it(root):
    catalogue = Catalogue(root)
    assert catalogue.scan('s1').calibration == ''
    assert all(add_calibration(catalogue, name, root / name) for name in ('s1', 's2', 's1'))
    digest = hashlib.sha256((root / 's1' / 'cell.yaml').read_bytes()).hexdigest()
    assert {catalogue.scan(name).calibration for name in ('s1', 's2')} == {digest}
    with catalogue.database.read() as connection:
        [row] = connection.execute(sql.select(CALIBRATIONS)).mappings()
    assert row['document'] == (root / 's1' / 'cell.yaml').read_text()
    found = catalogue.find(ScanFilter(calibration=digest[:8]))
    assert [scan.scan_id for scan in found] == ['s1', 's2']
    assert catalogue.find(ScanFilter(calibration='%')) == []
    # another calibration of the cell
    other = replace(CELL, turntable=replace(CELL.turntable, joint='axis'))
    save_cell(root / 's2' / 'cell.yaml', other)
    add_calibration(catalogue, 's2', root / 's2')
    assert [scan.scan_id for scan in catalogue.find(ScanFilter(calibration=digest))] == ['s1']


def test_acceptance_test_of_the_calibration_is_kept_once(root, tmp_path):
    (tmp_path / 'cell.check.json').write_text(json.dumps(record()))
    catalogue = Catalogue(root)
    for name in ('s1', 's2', 's1'):
        copy_record(tmp_path / 'cell.yaml', root / name)
        add_calibration(catalogue, name, root / name)
    [found] = certificates(catalogue, 's2')
    assert (found.created, found.verdict) == ('2026-11-20T10:00:00+00:00', 'pass')
    later = record(created='2026-11-27T10:00:00+00:00', verdict='fail')
    (root / 's1' / 'cell.check.json').write_text(json.dumps(later))
    add_calibration(catalogue, 's1', root / 's1')
    assert [row.verdict for row in certificates(catalogue, 's2')] == ['pass', 'fail']


@pytest.mark.parametrize(
    'text', [json.dumps(record(calibration='0' * 12)), json.dumps({'verdict': 'pass'}), '[', '[]']
)
def test_record_of_another_calibration_or_a_damaged_one_is_left_out(root, text):
    catalogue = Catalogue(root)
    (root / 's1' / 'cell.check.json').write_text(text)
    assert add_calibration(catalogue, 's1', root / 's1')
    assert catalogue.scan('s1').calibration
    assert certificates(catalogue, 's1') == []


def test_scan_without_a_calibration_is_a_scan(root):
    catalogue = Catalogue(root)
    (root / 's1' / 'cell.yaml').write_text('version: [')
    (root / 's2' / 'cell.yaml').unlink()
    for name in ('s1', 's2'):
        assert not add_calibration(catalogue, name, root / name)
        assert catalogue.scan(name).calibration == ''
        assert certificates(catalogue, name) == []


def test_calibration_is_rebuilt_from_the_folder(root, tmp_path):
    (tmp_path / 'cell.check.json').write_text(json.dumps(record()))
    copy_record(tmp_path / 'cell.yaml', root / 's1')
    (root / 'catalogue.sqlite3').unlink()
    catalogue = Catalogue(root, create=True)
    rebuild_scan(catalogue, root / 's1')
    assert catalogue.scan('s1').calibration
    assert [row.verdict for row in certificates(catalogue, 's1')] == ['pass']


def test_cell_without_a_test_has_no_record(root, tmp_path):
    copy_record(tmp_path / 'cell.yaml', root / 's1')
    assert not (root / 's1' / 'cell.check.json').exists()
