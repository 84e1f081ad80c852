# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from ivfmc_ros.codes import CODES
from ivfmc_ros.inspection.verdict import VERDICTS
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.window.status_text import features_html
from ivfmc_ros.window.status_text import health_html
from ivfmc_ros.window.status_text import message_html
from ivfmc_ros.window.status_text import scan_state
from ivfmc_ros.window.status_text import verdict_html


@pytest.mark.parametrize('stage', [str(stage) for stage in Stage])
def test_every_stage_has_words(stage):
    headline = scan_state({'stage': stage}).headline
    assert headline
    assert headline[0].islower()


def test_progress_of_a_scan():
    values = {'stage': 'SCANNING', 'profiles_done': '50', 'profiles_total': '200', 'eta_s': '12.4'}
    state = scan_state(values)
    assert state.percent == 25.0
    assert state.headline == 'scanning: 50 of 200 profiles, about 12 s left'
    assert (state.running, state.pausable, state.paused) == (True, True, False)


def test_more_profiles_than_planned_are_no_more_than_all():
    assert scan_state({'profiles_done': '259', 'profiles_total': '200'}).percent == 100.0


@pytest.mark.parametrize('value', ['', 'nan?', '-3', 'x'])
def test_damaged_numbers_count_as_none(value):
    values = {'stage': 'SCANNING', 'profiles_done': value, 'profiles_total': value}
    assert scan_state(values).percent == 0.0


def test_damaged_result_is_none():
    assert scan_state({'result': '{"code": '}).result == {}
    assert scan_state({'result': '[1]'}).result == {}


def test_verdict_is_shown_large_and_the_code_where_there_is_none():
    good = scan_state({'stage': 'DONE', 'code': 'OK', 'verdict': 'pass'})
    assert '>PASS<' in verdict_html(good)
    assert '4rem' in verdict_html(good)
    assert '>OK<' in verdict_html(scan_state({'stage': 'DONE', 'code': 'OK'}))
    failed = scan_state({'stage': 'FAILED', 'code': 'CAMERA_LOST'})
    assert '>CAMERA_LOST<' in verdict_html(failed)
    assert verdict_html(scan_state({'stage': 'SCANNING', 'code': ''})) == ''


def test_verdict_of_a_scan_that_is_not_ok_is_its_code():
    slipped = scan_state({'stage': 'FAILED', 'code': 'SLIPPED', 'verdict': 'pass'})
    assert '>SLIPPED<' in verdict_html(slipped)
    assert 'PASS' not in verdict_html(slipped)


@pytest.mark.parametrize('verdict', VERDICTS)
def test_only_pass_is_green_and_only_fail_is_red(verdict):
    html = verdict_html(scan_state({'stage': 'DONE', 'code': 'OK', 'verdict': verdict}))
    assert f'>{verdict.upper()}<' in html
    assert ('#0b5d1e' in html) == (verdict == 'pass')
    assert ('#8f1010' in html) == (verdict == 'fail')


@pytest.mark.parametrize('code', [code for code in CODES if code != 'OK'])
def test_every_code_comes_with_its_remedy(code):
    result = json.dumps({'code': code, 'detail': 'a <cause> & more'})
    text = message_html(scan_state({'stage': 'FAILED', 'code': code, 'result': result}))
    assert 'a &lt;cause&gt; &amp; more' in text
    assert 'Remedy' in text
    assert '`' not in text


def test_nothing_is_said_of_a_good_scan():
    assert message_html(scan_state({'stage': 'DONE', 'code': 'OK', 'result': '{}'})) == ''


def test_health_says_the_state_in_words_and_escapes_messages():
    text = health_html([('camera', 'lost', '<b>silent</b>'), ('mesher', 'ok', 'running')])
    assert '<td>lost</td>' in text
    assert '&lt;b&gt;silent' in text


def test_features_have_deviation_and_uncertainty_in_mm():
    row = {
        'feature': 'hole 3', 'characteristic': 'diameter', 'nominal_m': 0.009,
        'measured_m': 0.00912, 'U_m': 2e-5, 'verdict': 'fail',
    }  # fmt: skip
    text = features_html({'inspection': {'characteristics': [row]}})
    for part in ('hole 3 diameter', '+0.120', '>0.020<', 'fail'):
        assert part in text
    assert features_html({}) == ''
