# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Answers that the middleware first gives up, on a service that warns as rclpy's does."""

from types import SimpleNamespace
import warnings

import pytest
from support.graph_rig import running

from ivfmc_ros.nodes.framework.service_retry import PATIENCE_S
from ivfmc_ros.nodes.framework.service_retry import persistent
from ivfmc_ros.nodes.framework.service_retry import RETRY_S

# a node in whose process the first three answers are given up, as rmw_fastrtps does it
UNHEARD = """
import sys
import warnings
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from rclpy.service import Service

send = Service.send_response
given_up = []

def send_response(service, response, header):
    if len(given_up) < 3:
        given_up.append(header)
        warnings.warn('failed to send response (timeout): ...', RuntimeWarning)
    else:
        send(service, response, header)

Service.send_response = send_response

class Unheard(CellNode):
    def __init__(self):
        super().__init__('unheard')
        self.trigger('ask', lambda: {'given_up': len(given_up)})

sys.exit(run(Unheard))
"""


class Service(SimpleNamespace):
    """Fails to send so many times."""

    srv_name = 'plain/wait'

    def send_response(self, response, header):
        self.attempts.append((response, header))
        if len(self.attempts) <= self.deaf:
            warnings.warn('failed to send response (timeout): ...', RuntimeWarning, stacklevel=1)


@pytest.fixture
def calls():
    """What is to be done later, as (seconds, function)."""
    return []


def sent(service, calls):
    persistent(service, lambda *call: calls.append(call)).send_response('answer', 'header')
    for _, function in calls:
        function()
    return service.attempts


def test_what_is_heard_is_sent_once(calls):
    assert sent(Service(attempts=[], deaf=0), calls) == [('answer', 'header')]
    assert calls == []


def test_what_is_not_heard_is_sent_again(calls):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        attempts = sent(Service(attempts=[], deaf=3), calls)
    assert attempts == [('answer', 'header')] * 4
    assert [seconds for seconds, _ in calls] == [RETRY_S] * 3


def test_who_never_hears_is_given_up_with_a_warning(calls):
    service = Service(attempts=[], deaf=10_000)
    with pytest.warns(RuntimeWarning, match='plain/wait: failed to send response'):
        sent(service, calls)
    assert len(service.attempts) == pytest.approx(1 + PATIENCE_S / RETRY_S, abs=1)


def test_another_warning_is_passed_on(calls):
    service = Service(attempts=[], deaf=0)
    service.send_response = lambda *_: warnings.warn('odd', DeprecationWarning, stacklevel=1)
    with pytest.warns(DeprecationWarning, match='odd'):
        sent(service, calls)


def test_a_node_answers_a_client_that_it_discovers_late(client, script):
    script(UNHEARD)
    with running('unheard'):
        assert client.trigger('unheard/ask', 20.0)[0]
