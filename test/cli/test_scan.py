# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from contextlib import nullcontext
import signal

from click.testing import CliRunner
import pytest

from ivfmc_ros.cli.scan import resume_scan
from ivfmc_ros.cli.scan import run_scan
from ivfmc_ros.cli.scan import scan
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError


@pytest.mark.parametrize(('text', 'name'), [('cell', '/cell'), ('/a/b/', '/a/b'), ('', '/')])
def test_namespaces_are_completed(text, name):
    assert namespace_of(text) == name


@pytest.mark.parametrize('text', ['my cell', 'zelle-1', '1a', 'a//b', 'é'])
def test_namespace_that_cannot_be_one_is_refused(text):
    with pytest.raises(ParameterError, match='--namespace'):
        namespace_of(text)


class EndingClient:
    """Of a cell whose scan ends in the moment in which it is cancelled."""

    def __init__(self, code):
        self.code = code
        self.status = {}
        self.silent_s = 0.0

    def trigger(self, name):
        if name == 'start_scan':
            return {'scan_id': 's1'}
        self.status = {'scan_id': 's1', 'result': '{"code": "OK", "said": 1}'}
        raise HelperError(self.code, 'no scan is running')

    def parameters(self, node, values):
        return nullcontext()

    def until(self, condition, seconds, what):
        signal.raise_signal(signal.SIGINT)


def test_scan_that_ended_before_it_was_cancelled_has_its_result():
    assert run_scan(EndingClient('WRONG_STATE'), {})['said'] == 1
    with pytest.raises(HelperError):
        run_scan(EndingClient('INTERNAL'), {})


class SilentClient(EndingClient):
    """Of a cell whose orchestrator was killed."""

    def until(self, condition, seconds, what):
        self.silent_s = 6.0
        while not condition():
            pass


def test_scan_of_an_orchestrator_that_was_killed_ends_by_name():
    with pytest.raises(HelperError, match='gives no heartbeat for 6 s') as caught:
        run_scan(SilentClient(''), {})
    assert caught.value.code == 'ORCHESTRATOR_LOST'


class ResumingClient:
    """Of a cell that publishes the interruption of a scan, and then its good end."""

    def __init__(self):
        self.silent_s = 0.0
        self.status = {}
        self.set = {}
        self.coming = [{'scan_id': 's1', 'result': '{"code": "INTERRUPTED"}'}]

    def trigger(self, name, seconds):
        assert name == 'resume'
        self.coming = [{'scan_id': 's1', 'result': '{"code": "OK", "resumed": true}'}]
        return {'scan_id': 's1'}

    def parameters(self, node, values):
        self.set.update({node: values})
        return nullcontext()

    def until(self, condition, seconds, what):
        if self.coming:
            self.status = self.coming.pop()
        assert condition()


def test_interruption_of_a_scan_is_not_taken_for_its_end():
    client = ResumingClient()
    assert resume_scan(client, 's1') == {'code': 'OK', 'resumed': True}
    assert client.set == {'orchestrator': {'resume_scan': 's1'}}


def test_resumed_scan_takes_no_other_options():
    result = CliRunner().invoke(scan, ['--resume', 's1', '--profiles', '20'])
    assert isinstance(result.exception, ParameterError)
    assert 'leave out profiles' in str(result.exception)
