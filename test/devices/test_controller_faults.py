# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the controller behind the driver; ``make bench NAME=hardware`` measures them all."""

import pytest
from support.controller_faults import CASES
from support.controller_faults import outcome
from support.controller_faults import refused

# Those that no other test of the driver or its controller has.
HERE = ('safety door', 'alarm 8', 'stray ok', 'stray error', 'half a line')


@pytest.mark.parametrize(
    'case', [case for case in CASES if case.name in HERE], ids=lambda c: c.name
)
def test_fault_has_its_code_the_beam_is_off_and_the_driver_goes_on(case, tmp_path):
    found = outcome(case, tmp_path)
    assert found.code in case.codes
    assert found.detected_s < 2.0
    assert found.dark_s < 2.0
    assert found.recovered_s < 3.0
    assert found.good


@pytest.mark.parametrize(
    ('case', 'said'),
    [('taken', 'lock'), ('wrong controller', 'Repetier'), ('wrong baud rate', 'baud rate')],
)
def test_controller_that_cannot_be_connected_is_named(case, said, tmp_path, monkeypatch):
    monkeypatch.setattr('ivfmc_ros.devices.detection._GREETING_S', 0.5)
    monkeypatch.setattr('ivfmc_ros.devices.detection._ANSWER_S', 0.2)
    assert said in refused(tmp_path, case)
