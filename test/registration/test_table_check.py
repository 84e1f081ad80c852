# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.registration.table_check import TableCheck
from ivfmc_ros.registration.table_check import with_triggers
from ivfmc_ros.registration.views.motion_fit import SweepMotion
from ivfmc_ros.registration.views.trigger_grid import TriggerCheck

GOOD = TableCheck(code='OK', detail='')


def motion(view=0, code='', detail=''):
    return SweepMotion(view=view, trigger=TriggerCheck(step=0.01, code=code, detail=detail))


def test_dropped_triggers_are_said_beside_ok():
    found = with_triggers(GOOD, [motion(detail='3 steps without a picture'), SweepMotion(view=1)])
    assert (found.code, found.detail) == ('OK', '')
    assert found.triggers == 'view 0: 3 steps without a picture'


@pytest.mark.parametrize('code', ['SLIPPED', 'TRIGGER_REFUSED'])
@pytest.mark.parametrize('surfaces', ['OK', 'UNCHECKED'])
def test_uncertain_trigger_is_never_ok(code, surfaces):
    before = TableCheck(code=surfaces, detail='nothing would show a slip')
    found = with_triggers(before, [motion(), motion(view=1, code=code, detail='why')])
    assert (found.code, found.detail) == (code, 'view 1: why')


def test_slip_goes_before_a_refusal():
    checks = [
        motion(code='TRIGGER_REFUSED', detail='a'),
        motion(view=1, code='SLIPPED', detail='b'),
    ]
    found = with_triggers(GOOD, checks)
    assert (found.code, found.detail) == ('SLIPPED', 'view 0: a; view 1: b')


def test_surfaces_that_disagree_keep_their_code():
    before = TableCheck(code='NOT_CONVERGED', detail='no poses')
    found = with_triggers(before, [motion(code='SLIPPED', detail='why')])
    assert (found.code, found.detail) == ('NOT_CONVERGED', 'no poses; view 0: why')


def test_without_triggers_nothing_changes():
    assert with_triggers(GOOD, [SweepMotion(view=0)]) == GOOD
