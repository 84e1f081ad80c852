# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import contextlib
import http.client
import http.server
import socket
import threading
import time

import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.gate import Gate


class Page(http.server.BaseHTTPRequestHandler):
    """Answers GET; echoes everything after an upgrade."""

    protocol_version = 'HTTP/1.1'
    seen = None

    def do_GET(self):
        type(self).seen = dict(self.headers)
        if self.headers.get('upgrade') == 'websocket':
            self.send_response(101)
            self.end_headers()
            self.wfile.flush()
            while data := self.connection.recv(65536):
                self.connection.sendall(data)
            self.close_connection = True
            return
        body = b'the page'
        self.send_response(200)
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments):
        pass


@pytest.fixture
def inner():
    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Page)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server.server_port
    server.shutdown()
    server.server_close()


@contextlib.contextmanager
def gate(inner, token=''):
    lines = []
    gate = Gate('127.0.0.1', 0, inner, Access(token=token), lines.append)
    gate.lines = lines
    try:
        yield gate
    finally:
        gate.stop()


def get(port, target='/', **headers):
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=5)
    try:
        connection.request('GET', target, headers=headers)
        response = connection.getresponse()
        return response.status, response.read()
    finally:
        connection.close()


@contextlib.contextmanager
def upgraded(port):
    with socket.create_connection(('127.0.0.1', port), 5) as connection:
        connection.sendall(
            f'GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n'
            f'Connection: Upgrade\r\nOrigin: http://127.0.0.1:{port}\r\n\r\n'.encode()
        )
        data = b''
        while b'\r\n\r\n' not in data:
            data += connection.recv(4096)
        assert b'101' in data.split(b'\r\n')[0]
        yield connection


def test_request_is_forwarded_without_its_cookie(inner):
    with gate(inner, '0123456789abcdef') as opened:
        status, body = get(opened.port, Cookie='ivfmc_window=0123456789abcdef')
        assert (status, body) == (200, b'the page')
        assert 'cookie' not in {name.lower() for name in Page.seen}


def test_websocket_is_forwarded_both_ways(inner):
    with gate(inner) as opened, upgraded(opened.port) as connection:
        connection.sendall(b'hello')
        assert connection.recv(100) == b'hello'


def test_browser_that_sends_too_much_is_cut_off(inner):
    with gate(inner) as opened, upgraded(opened.port) as connection:

        def drain():
            with contextlib.suppress(OSError):
                while connection.recv(1 << 20):
                    pass

        reader = threading.Thread(target=drain, daemon=True)
        reader.start()
        with pytest.raises(OSError):
            for _ in range(100):
                connection.sendall(bytes(1_000_000))
                time.sleep(0.001)
        assert opened.refused['a message that is too large'] == 1
        # others are not concerned
        assert get(opened.port)[0] == 200


def test_refusals_are_counted_and_logged_once(inner):
    with gate(inner) as opened:
        for _ in range(200):
            assert get(opened.port, Origin='http://evil.example')[0] == 403
        assert opened.refused['a page of another origin'] == 200
        assert opened.lines == ['refused 1 request: a page of another origin']
        assert get(opened.port)[0] == 200


def test_what_is_no_request_is_answered_and_closed(inner):
    with gate(inner) as opened:
        for data in (b'\x16\x03\x01\x02\x00\r\n\r\n', b'GET ' + b'x' * 40_000):
            with socket.create_connection(('127.0.0.1', opened.port), 5) as connection:
                connection.sendall(data)
                answer = connection.recv(4096)
                assert answer.startswith(b'HTTP/1.1 400') or not answer
        assert get(opened.port)[0] == 200


def test_second_request_of_a_connection_does_not_pass_unchecked(inner):
    with gate(inner) as opened:
        with socket.create_connection(('127.0.0.1', opened.port), 5) as connection:
            first = f'GET / HTTP/1.1\r\nHost: 127.0.0.1:{opened.port}\r\n\r\n'
            second = 'GET /second HTTP/1.1\r\nHost: evil.example\r\n\r\n'
            connection.sendall((first + second).encode())
            data = b''
            with contextlib.suppress(OSError):
                while chunk := connection.recv(4096):
                    data += chunk
        assert data.count(b'HTTP/1.1') == 1


def test_more_connections_than_browsers_need_are_refused(inner):
    with gate(inner) as opened, contextlib.ExitStack() as stack:
        for _ in range(64):
            stack.enter_context(upgraded(opened.port))
        assert get(opened.port)[0] == 503
        stack.close()
        deadline = time.monotonic() + 5.0
        while get(opened.port)[0] != 200:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_address_that_is_taken_is_named(inner):
    with gate(inner) as opened, pytest.raises(ParameterError, match=str(opened.port)):
        Gate('127.0.0.1', opened.port, inner, Access(), print)
