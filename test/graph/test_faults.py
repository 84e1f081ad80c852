# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A sample of the faults of ``make faults``, drawn by a seed, in a cell of real processes."""

import numpy as np
import pytest
from support import fault_cases
from support.fault_cell import FaultCell
from support.fault_cell import FaultClient
from support.fault_effects import Baselines
from support.fault_effects import run_case

SEED, COUNT = 1, 2
# The bars of the bench, seconds; half as much again, because other programs may run beside.
DETECTION_S, BEAM_S = 1.5 * 2.0, 1.5 * 1.0


def sample():
    """Faults of the hardware, after which the cell need not be started again."""
    cases = [*fault_cases.measuring_cases(), *fault_cases.controller_cases()]
    cases = [case for case in cases if case.stage == 'scanning']
    chosen = np.random.default_rng(SEED).choice(len(cases), COUNT, replace=False)
    return [cases[index] for index in chosen]


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    client = FaultClient()
    cell = FaultCell(client, tmp_path_factory.mktemp('faults'))
    yield cell
    cell.end()
    client.close()
    assert cell.orphans == 0


@pytest.fixture(scope='module')
def baselines(cell):
    return Baselines(cell)


@pytest.mark.parametrize('case', sample(), ids=lambda case: case.name)
def test_fault_is_noticed_or_does_no_harm_and_the_next_scan_is_good(cell, baselines, case):
    effect = run_case(cell, baselines, case)
    assert not effect.wrong or effect.detail, effect
    assert effect.lost == 0, effect
    assert effect.next_code == 'OK', effect
    if effect.stopped:
        assert effect.detected_s < DETECTION_S, effect
        since_s = 0.0 if case.hazard else effect.detected_s
        assert effect.beam_off_s - since_s < BEAM_S, effect
