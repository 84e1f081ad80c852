# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from datetime import date
from datetime import datetime
from datetime import UTC
import json
from pathlib import Path

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros import __version__
from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.reports.json_report import residuals
from ivfmc_ros.inspection.reports.json_report import scale
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.align import Verdict
from ivfmc_ros.registration.views.assemble import assemble


def refuse(constant):
    pytest.fail(f'{constant} is no JSON')


def read(path):
    return json.loads(path.read_text(), parse_constant=refuse)


def sphere_views(count=1):
    cell, sphere = small_cell(), Sphere(np.array([0.006, 0.0, 0.045]), 0.02)
    return [
        assemble(cell, sphere_profiles(cell, sphere, 30, laser=k, view=k))[0] for k in range(count)
    ]


def test_report_says_who_made_it_and_when(tmp_path):
    write_report(tmp_path / 'report.json', {'counts': {'pictures': 3}})
    document = read(tmp_path / 'report.json')
    assert document['ivfmc_ros'] == __version__
    assert abs((datetime.now(UTC) - datetime.fromisoformat(document['created'])).seconds) < 60
    assert document['counts'] == {'pictures': 3}


def test_what_is_no_number_is_null(tmp_path):
    values = {
        'nan': float('nan'),
        'deep': [{'inf': float('-inf')}, (np.float64('nan'), np.float32(1.5))],
        'array': np.array([[1.0, np.nan]]),
        'count': np.int64(7),
        'truth': np.bool_(True),
        3: Path('a') / 'b',
    }
    write_report(tmp_path / 'report.json', values)
    document = read(tmp_path / 'report.json')
    assert document['nan'] is None
    assert document['deep'] == [{'inf': None}, [None, 1.5]]
    assert document['array'] == [[1.0, None]]
    assert document['count'] == 7
    assert document['truth'] is True
    assert document['3'] == str(Path('a') / 'b')


def test_date_that_a_cell_notes_is_written(tmp_path):
    # YAML reads 2026-11-23 as a date
    cell = replace(small_cell(), notes={'board': {'measured': date(2026, 11, 23)}})
    write_report(tmp_path / 'report.json', {'scale': scale(cell)})
    assert read(tmp_path / 'report.json')['scale'] == {'board': {'measured': '2026-11-23'}}


def test_scale_without_a_known_length_says_so():
    assert scale(small_cell())['board'] is None
    assert 'no known length' in scale(small_cell())['note']


def test_residuals_of_a_real_registration_are_written(tmp_path):
    views = sphere_views(2)
    _, verdicts = align(views, 'table')
    write_report(tmp_path / 'report.json', residuals(small_cell(), views, verdicts))
    document = read(tmp_path / 'report.json')
    assert document['calibration']['laser_rms_m'] == {'left': 0.0, 'right': 0.0}
    assert document['point_sigma_m'] == {'median': 1e-5, 'p95': 1e-5}
    assert [verdict['view'] for verdict in document['registration']] == [0, 1]
    # not measured: null, and not 0
    assert document['registration'][1]['rms_before'] is None
    assert document['registration_checked'] is False


@pytest.mark.parametrize(('overlap', 'checked'), [(0.0, False), (0.05, False), (0.9, True)])
def test_little_overlap_does_not_count_as_checked(overlap, checked):
    verdict = Verdict(view=1, applied=False, why='table believed', overlap=overlap)
    found = residuals(small_cell(), sphere_views(), [verdict])
    assert found['registration_checked'] is checked


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match=r'none.report\.json: cannot be written'):
        write_report(tmp_path / 'none' / 'report.json', {})
