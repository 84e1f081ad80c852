# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Answers that the middleware first gives up, on a service that warns as rclpy's does."""

from types import SimpleNamespace
import warnings

import pytest
from support.graph_rig import running

from ivfmc_ros.nodes.framework.service_retry import retry_responses
from ivfmc_ros.nodes.framework.service_retry import RETRY_S
from ivfmc_ros.nodes.framework.service_retry import TIMEOUT_S

# a node whose first three responses are dropped as rmw_fastrtps does it
DROPPING = """
import sys
import warnings
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from rclpy.service import Service

send = Service.send_response
dropped = []

def send_response(service, response, header):
    if len(dropped) < 3:
        dropped.append(header)
        warnings.warn('failed to send response (timeout): ...', RuntimeWarning)
    else:
        send(service, response, header)

Service.send_response = send_response

class Dropping(CellNode):
    def __init__(self):
        super().__init__('dropping')
        self.trigger('ask', lambda: {'dropped': len(dropped)})

sys.exit(run(Dropping))
"""


class Service(SimpleNamespace):
    """Fails to send the first ``failures`` responses."""

    srv_name = 'plain/wait'

    def send_response(self, response, header):
        self.attempts.append((response, header))
        if len(self.attempts) <= self.failures:
            warnings.warn('failed to send response (timeout): ...', RuntimeWarning, stacklevel=1)


@pytest.fixture
def calls():
    """Calls that were scheduled, as (seconds, function)."""
    return []


def sent(service, calls):
    retry_responses(service, lambda *call: calls.append(call)).send_response('answer', 'header')
    for _, function in calls:
        function()
    return service.attempts


def test_response_that_is_sent_is_not_repeated(calls):
    assert sent(Service(attempts=[], failures=0), calls) == [('answer', 'header')]
    assert calls == []


def test_response_that_fails_is_sent_again(calls):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        attempts = sent(Service(attempts=[], failures=3), calls)
    assert attempts == [('answer', 'header')] * 4
    assert [seconds for seconds, _ in calls] == [RETRY_S] * 3


def test_who_never_hears_is_dropped_with_a_warning(calls):
    service = Service(attempts=[], failures=10_000)
    with pytest.warns(RuntimeWarning, match='plain/wait: failed to send response'):
        sent(service, calls)
    assert len(service.attempts) == pytest.approx(1 + TIMEOUT_S / RETRY_S, abs=1)


def test_other_warnings_are_passed_on(calls):
    service = Service(attempts=[], failures=0)
    service.send_response = lambda *_: warnings.warn('odd', DeprecationWarning, stacklevel=1)
    with pytest.warns(DeprecationWarning, match='odd'):
        sent(service, calls)


def test_client_that_is_discovered_late_gets_its_response(client, script):
    script(DROPPING)
    with running('dropping'):
        assert client.trigger('dropping/ask', 20.0)[0]
