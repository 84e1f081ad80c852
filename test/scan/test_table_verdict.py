# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.table_verdict import judge_table


def judged(**table):
    outcome = Outcome(registration={'table': table} if table else {})
    judge_table(outcome)
    return outcome.code, outcome.detail


@pytest.mark.parametrize('code', ['SLIPPED', 'NOT_CONVERGED', 'TRIGGER_REFUSED'])
def test_scan_whose_views_disagree_is_not_ok(code):
    assert judged(code=code, detail='by +5.00 degrees') == (code, 'by +5.00 degrees')


def test_scan_that_could_not_be_checked_says_so_beside_ok():
    assert judged(code='UNCHECKED', detail='one sweep') == ('OK', 'UNCHECKED: one sweep')


def test_what_the_triggers_lack_is_said_beside_ok():
    said = judged(code='OK', detail='', triggers='view 0: 3 steps without a picture')
    assert said == ('OK', 'triggers: view 0: 3 steps without a picture')


def test_advice_of_the_lasers_is_said_beside_ok():
    outcome = Outcome(registration={'table': {'code': 'OK'}, 'lasers': {'advice': 'calibrate'}})
    judge_table(outcome)
    assert (outcome.code, outcome.detail) == ('OK', 'calibrate')
    outcome = Outcome(registration={'table': {'code': 'OK'}, 'lasers': None})
    judge_table(outcome)
    assert (outcome.code, outcome.detail) == ('OK', '')


def test_scan_whose_views_agree_says_nothing():
    assert judged(code='OK', detail='the part is round') == ('OK', '')
    assert judged() == ('OK', '')


def test_drift_of_a_laser_is_said_beside_the_code():
    said = 'left by +0.100 mm'
    assert judged(code='OK', detail='', drift=said) == ('OK', f'drift: {said}')
    code, detail = judged(code='SLIPPED', detail='by 2 degrees', drift=said)
    assert code == 'SLIPPED'
    assert said in detail
    # the detail of a scan that fails by its drift is not repeated
    failed = judged(code='NOT_CONVERGED', detail=said, drift=said)
    assert failed == ('NOT_CONVERGED', said)
