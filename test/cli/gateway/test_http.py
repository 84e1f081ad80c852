# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The HTTP gateway, driven by the client of the standard library and by raw sockets."""

from http.client import HTTPConnection
import json
import socket
import threading

from click.testing import CliRunner
import pytest
from support.gateway_rig import CellWithoutRos
from support.gateway_rig import gateway_of

from ivfmc_ros.cli.gateway import gateway as command
from ivfmc_ros.cli.gateway.http_server import GatewayServer
from ivfmc_ros.errors import ParameterError

TOKEN = 'a' * 24


@pytest.fixture
def cell():
    return CellWithoutRos()


@pytest.fixture
def serve(cell):
    """Return a function that starts a server and returns a function that asks it."""
    ends = []

    def start(token=''):
        made = gateway_of(cell)
        server = GatewayServer(('127.0.0.1', 0), made.__enter__(), token)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        ends.append((server, thread, made))

        def ask(method, path, body=None, **headers):
            connection = HTTPConnection('127.0.0.1', server.server_port, timeout=20.0)
            given = {'Authorization': f'Bearer {token}'} if token else {}
            try:
                connection.request(method, path, body, {**given, **headers})
                response = connection.getresponse()
                return response.status, json.loads(response.read())
            finally:
                connection.close()

        ask.port = server.server_port
        return ask

    yield start
    for server, thread, made in ends:
        server.close()
        thread.join(10.0)
        made.__exit__(None, None, None)


def test_scan_is_started_followed_and_ended(cell, serve):
    ask = serve()
    values = {'part': 'bracket', 'recipe': 'bracket', 'profiles': 400}
    assert ask('POST', '/start', json.dumps(values))[1]['scan_id'] == 'scan_1'
    assert cell.calls == [('start_scan', values)]
    events = Events(ask.port)
    assert events.until('SCANNING')['profiles_total'] == '400'
    cell.finish(verdict='fail')
    last = events.until('DONE')
    assert (last['alive'], last['verdict']) == (True, 'fail')
    assert last['result'] == {'code': 'OK', 'scan_id': 'scan_1', 'verdict': 'fail'}
    events.close()
    assert ask('GET', '/status') == (200, last)


class Events:
    """Server-sent events, read line by line."""

    def __init__(self, port):
        self._socket = socket.create_connection(('127.0.0.1', port), timeout=20.0)
        self._socket.sendall(b'GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n')
        self._lines = self._socket.makefile('rb')

    def until(self, stage):
        for line in self._lines:
            if line.startswith(b'data: '):
                state = json.loads(line.removeprefix(b'data: '))
                if state.get('stage') == stage:
                    return state
        raise AssertionError(f'the events ended without {stage}')

    def close(self):
        self._lines.close()
        self._socket.close()


@pytest.mark.parametrize(
    ('path', 'body', 'status', 'code', 'said'),
    [
        ('/start', '{"scan_root": "/etc"}', 400, 'BAD_PARAMETER', "'scan_root' cannot be set"),
        ('/start', '{"cell": "/etc/passwd"}', 400, 'BAD_PARAMETER', "'cell' cannot be set"),
        ('/start', '{"profiles": "many"}', 400, 'BAD_PARAMETER', 'must be a whole number'),
        ('/start', '[1]', 400, 'BAD_PARAMETER', 'must be a JSON object'),
        ('/start', '{', 400, 'BAD_PARAMETER', 'is not JSON'),
        ('/cancel', '{"part": "x"}', 400, 'BAD_PARAMETER', 'cancel takes no parameters'),
        ('/cancel', '', 409, 'WRONG_STATE', 'no scan is running'),
        ('/run', '', 404, 'BAD_PARAMETER', 'not found'),
        ('/../status', '', 404, 'BAD_PARAMETER', 'not found'),
    ],
)
def test_request_that_cannot_be_done_is_refused(serve, path, body, status, code, said):
    got, answer = serve()('POST', path, body)
    assert (got, answer['code']) == (status, code)
    assert said in answer['detail']


def test_second_start_names_the_scan_that_runs(serve):
    ask = serve()
    ask('POST', '/start')
    status, answer = ask('POST', '/start')
    assert (status, answer['code'], answer['scan_id']) == (409, 'BUSY', 'scan_1')


def test_wrong_token_and_pages_of_other_sites_reach_nothing(cell, serve):
    ask = serve(TOKEN)
    assert ask('POST', '/start', Authorization='Bearer ' + 'b' * 24)[0] == 401
    assert ask('GET', '/status', Authorization='')[0] == 401
    assert ask('GET', '/status')[0] == 200
    open_ask = serve()
    assert open_ask('POST', '/start', Origin='http://evil.example')[0] == 403
    # a name that was made to point here
    assert open_ask('GET', '/status', Host='evil.example')[0] == 403
    assert open_ask('GET', '/status', Host='localhost:8087')[0] == 200
    assert cell.calls == []


def test_body_without_end_is_refused_and_the_server_goes_on(serve):
    ask = serve()
    assert ask('POST', '/start', **{'Content-Length': '99999999'})[0] == 400
    assert ask('POST', '/start', **{'Content-Length': '-1'})[0] == 400
    assert ask('GET', '/status')[0] == 200


def test_client_that_does_not_read_its_events_delays_no_other(cell, serve):
    ask = serve()
    stream = socket.create_connection(('127.0.0.1', ask.port))
    stream.sendall(b'GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n')
    for number in range(300):
        cell.status = {**cell.status, 'profiles_done': str(number)}
    assert ask('POST', '/start')[0] == 200
    stream.close()


def test_many_clients_at_once_are_all_answered(serve):
    ask = serve()
    answers = []

    def call():
        answers.append(ask('POST', '/start')[0])

    threads = [threading.Thread(target=call) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert sorted(answers) == [200] + [409] * 19


def test_silent_cell_is_said(cell, serve):
    ask = serve()
    cell.silent_s = 60.0
    for _ in range(200):
        if not ask('GET', '/status')[1]['alive']:
            return
    raise AssertionError('the cell is still alive')


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['http', '--address', '0.0.0.0'], 'name a --token-file'),
        (['http', '--address', 'example.com'], 'is no IP address'),
        (['http', '--token-file', 'short'], 'at least 16 printable characters'),
        (['opcua'], '--user NAME, with its password'),
        (['opcua', '--user', 'plc'], 'must have 8 characters'),
        (['opcua', '--endpoint', 'http://x', '--anonymous'], 'must be opc.tcp://HOST:PORT'),
    ],
)
def test_unsafe_options_are_refused(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('IVFMC_GATEWAY_PASSWORD', raising=False)
    (tmp_path / 'short').write_text('abc')
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, ParameterError)
    assert said in str(result.exception)
