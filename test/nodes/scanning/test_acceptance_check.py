# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the last acceptance test of a cell lets the scan service accept a scan."""

from datetime import datetime
from datetime import timedelta
from datetime import UTC

import pytest

pytest.importorskip('rclpy')

from ivfmc_ros.acceptance.record import write_record
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.acceptance_check import require_check
from ivfmc_ros.simulation.bench import bench_cell


class Parameters:
    """Stands in for the node: values of parameters, and the warnings that are logged."""

    def __init__(self, cell, policy, max_age=30.0):
        self.values = {'cell': str(cell), 'check_policy': policy, 'check_max_age': max_age}
        self.warnings = []

    def get(self, name):
        return self.values[name]

    def get_logger(self):
        return self

    def warning(self, text):
        self.warnings.append(text)


@pytest.fixture
def cell_file(tmp_path):
    save_cell(tmp_path / 'cell.yaml', bench_cell())
    return tmp_path / 'cell.yaml'


def write(cell_file, verdict='pass', days=0.0, calibration=None):
    cell = bench_cell()
    own = calibration_id(cell.turntable, cell.lasers)
    created = (datetime.now(UTC) - timedelta(days=days)).isoformat()
    record = {'created': created, 'verdict': verdict, 'calibration': calibration or own}
    write_record(record_path(cell_file), record)


@pytest.mark.parametrize('policy', ['ignore', 'warn', 'refuse'])
def test_current_check_lets_every_scan_pass(cell_file, policy):
    write(cell_file, days=2.0)
    node = Parameters(cell_file, policy)
    require_check(node)
    assert node.warnings == []


@pytest.mark.parametrize(
    ('record', 'text'),
    [
        ({'days': 31.0}, '31 days old'),
        ({'verdict': 'fail'}, 'ended with fail'),
        ({'verdict': 'not decided'}, 'ended with not decided'),
        ({'calibration': 'abc'}, 'calibration abc'),
    ],
)
def test_check_that_does_not_count_warns_or_refuses(cell_file, record, text):
    write(cell_file, **record)
    node = Parameters(cell_file, 'warn')
    require_check(node)
    assert len(node.warnings) == 1
    assert text in node.warnings[0]
    with pytest.raises(HelperError, match=text) as refused:
        require_check(Parameters(cell_file, 'refuse'))
    assert refused.value.code == 'NOT_CHECKED'
    silent = Parameters(cell_file, 'ignore')
    require_check(silent)
    assert silent.warnings == []


def test_cell_that_was_never_checked_is_refused_only_where_that_is_asked_for(cell_file):
    node = Parameters(cell_file, 'warn')
    require_check(node)
    assert node.warnings == []
    with pytest.raises(HelperError, match='never checked'):
        require_check(Parameters(cell_file, 'refuse'))


def test_missing_cell_is_left_to_its_own_error(tmp_path):
    require_check(Parameters(tmp_path / 'none.yaml', 'refuse'))
    require_check(Parameters('', 'refuse'))
