# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The schema of answers names every service; the client of the tests validates answers by it."""

import json
import re

from jsonschema import Draft202012Validator
import pytest
from support import answer_schema
from support.house import ROOT

from ivfmc_ros.errors import BusyError
from ivfmc_ros.nodes.framework.json_response import error_response
from ivfmc_ros.nodes.scanning.running_scan import RunningScan


def services():
    """Return the services that the sources of the nodes create, by their names in the cell."""
    found = set()
    for path in sorted((ROOT / 'ivfmc_ros' / 'nodes').glob('*.py')):
        text = path.read_text(encoding='utf-8')
        prefix = '' if path.stem == 'orchestrator' else f'{path.stem}/'
        names = re.findall(r"self\.trigger\('(\w+)'", text)
        names += re.findall(r"\('(\w+)', self\._\w+\),\n", text) if not prefix else []
        names += ['<laser>/enable'] if '/enable' in text and path.stem == 'turntable' else []
        found |= {prefix + name for name in names}
    return found


def test_schema_is_a_schema():
    document = answer_schema.schema()
    Draft202012Validator.check_schema(document)
    for each in document['$defs'].values():
        Draft202012Validator.check_schema(each)


def test_every_service_has_a_schema_and_every_schema_a_service():
    named = set(answer_schema.schema()['$defs']) - {'error', 'scan_status'}
    assert named == services()
    assert {'scan', 'start_scan', 'mesher/build', 'turntable/<laser>/enable'} <= named


@pytest.mark.parametrize(
    ('service', 'success', 'answer'),
    [
        ('start_scan', True, {'code': 'OK', 'scan_id': 's'}),
        ('start_scan', True, {'code': 'BUSY', 'scan_id': 's', 'folder': 'f'}),
        ('registrar/cancel', True, {'code': 'OK', 'cancelled': 'yes'}),
        ('cancel', True, {'code': 'OK', 'scan_id': 's', 'stage': 'ALMOST'}),
        ('scan', False, {'code': 'OK', 'detail': 'it failed'}),
        ('scan', False, {'code': 'BUSY', 'detail': ''}),
    ],
)
def test_answer_of_another_form_is_found(service, success, answer):
    with pytest.raises(AssertionError, match=f'{service} '):
        answer_schema.require_valid(service, success, answer)


def test_error_and_first_status_have_the_form_of_the_schema():
    for error in (BusyError('a scan is running', scan_id='s'), ZeroDivisionError('by zero')):
        answer_schema.require_valid('scan', False, json.loads(error_response(error)))
    answer_schema.require_valid_status(RunningScan.idle_status())
