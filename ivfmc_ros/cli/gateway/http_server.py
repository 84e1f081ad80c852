# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
HTTP server of a ``CellGateway``.

Clients that do not read are no load: each event stream holds one state, and misses those that it
did not fetch in time.
"""

from concurrent.futures import TimeoutError as FutureTimeoutError
import contextlib
import hmac
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from http.server import ThreadingHTTPServer
import ipaddress
import json
import queue
import re
import socket
import threading
from typing import Any

from ivfmc_ros.cli.gateway.cell_gateway import ACTIONS
from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.cli.gateway.cell_gateway import CellState
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError

# Bytes of a request's body at most.
_MAX_BODY = 65_536
# Seconds: for a client that sends nothing, for an answer of the cell, between two signs of life.
_SOCKET_S, _ANSWER_S, _BEAT_S = 30.0, 40.0, 10.0
# Event streams at most; each holds a thread.
_MAX_STREAMS = 32
_JSON = 'application/json'

# HTTP status of a refusal, by its code; what is not here is the cell's fault (502).
_STATUS = {
    'BUSY': HTTPStatus.CONFLICT,
    'WRONG_STATE': HTTPStatus.CONFLICT,
    'BAD_PARAMETER': HTTPStatus.BAD_REQUEST,
    'BAD_RECIPE': HTTPStatus.BAD_REQUEST,
    'TIMEOUT': HTTPStatus.GATEWAY_TIMEOUT,
    'INTERRUPTED': HTTPStatus.SERVICE_UNAVAILABLE,
}


class GatewayServer(ThreadingHTTPServer):
    """
    Serves a gateway.

    token : that every request has to send; '' for none
    ending : set when the server ends
    """

    daemon_threads = True
    # a stream of events would be waited for
    block_on_close = False

    def __init__(self, place: tuple[str, int], gateway: CellGateway, token: str) -> None:
        if ipaddress.ip_address(place[0]).version == 6:
            self.address_family = socket.AF_INET6
        super().__init__(place, _Handler)
        self.gateway, self.token = gateway, token
        self.ending = threading.Event()
        self.streams = threading.BoundedSemaphore(_MAX_STREAMS)

    def close(self) -> None:
        """End the server and its event streams."""
        self.ending.set()
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: GatewayServer
    protocol_version = 'HTTP/1.1'
    timeout = _SOCKET_S

    def do_GET(self) -> None:
        """Answer /status and /events."""
        if not self._is_allowed():
            return
        if self.path == '/status':
            self._send(HTTPStatus.OK, self.server.gateway.state.as_dict())
        elif self.path == '/events':
            self._stream()
        else:
            self._refuse(HTTPStatus.NOT_FOUND, 'BAD_PARAMETER', f'{self.path}: not found')

    def do_POST(self) -> None:
        """Answer /start, /cancel, /pause and /resume."""
        if not self._is_allowed():
            return
        action = self.path.removeprefix('/')
        if action not in ACTIONS:
            self._refuse(HTTPStatus.NOT_FOUND, 'BAD_PARAMETER', f'{self.path}: not found')
            return
        try:
            answer = self.server.gateway.request(action, self._body()).result(_ANSWER_S)
        except FutureTimeoutError:
            text = f'the cell did not answer within {_ANSWER_S:.0f} s'
            self._refuse(HTTPStatus.GATEWAY_TIMEOUT, 'TIMEOUT', text)
        except ScanError as error:
            more = error.values if isinstance(error, HelperError) else {}
            status = _STATUS.get(error.code, HTTPStatus.BAD_GATEWAY)
            self._refuse(status, error.code, str(error), **more)
        else:
            self._send(HTTPStatus.OK, answer)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: clients ask for the status every second."""

    def _is_allowed(self) -> bool:
        """Refuse a wrong token, and pages of other sites that a browser shows here."""
        token = self.server.token
        given = self.headers.get('Authorization', '')
        if token and not hmac.compare_digest(given.encode(), f'Bearer {token}'.encode()):
            self.close_connection = True
            self._refuse(HTTPStatus.UNAUTHORIZED, 'BAD_PARAMETER', 'Authorization: wrong token')
            return False
        foreign = self.headers.get('Origin') is not None or not _is_address(self.headers['Host'])
        if foreign and not token:
            self.close_connection = True
            text = 'Origin, Host: pages of other sites are not served'
            self._refuse(HTTPStatus.FORBIDDEN, 'BAD_PARAMETER', text)
            return False
        return True

    def _body(self) -> dict[str, Any]:
        """
        Return the parameters that the request sends.

        :raises ParameterError: it is too long, or no JSON object
        """
        length = self.headers.get('Content-Length', '0')
        if (
            not length.isdecimal()
            or int(length) > _MAX_BODY
            or self.headers.get('Transfer-Encoding')
        ):
            self.close_connection = True
            raise ParameterError(f'Content-Length: must be a number up to {_MAX_BODY}')
        data = self.rfile.read(int(length))
        if not data.strip():
            return {}
        try:
            values = json.loads(data)
        except ValueError as error:
            raise ParameterError(f'the request is not JSON: {error}') from None
        if not isinstance(values, dict):
            raise ParameterError('the request must be a JSON object of parameters')
        return values

    def _stream(self) -> None:
        if not self.server.streams.acquire(blocking=False):
            text = f'{_MAX_STREAMS} clients follow the events already'
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, 'BUSY', text)
            return
        states: queue.Queue[CellState] = queue.Queue(1)
        end = self.server.gateway.listen(lambda state: _replace(states, state))
        try:
            self.send_response(HTTPStatus.OK)
            self.send_header('Content-Type', 'text/event-stream')
            self.send_header('Cache-Control', 'no-store')
            self.end_headers()
            self.close_connection = True
            self._send_events(states)
        except OSError:
            # the client is gone
            self.close_connection = True
        finally:
            end()
            self.server.streams.release()

    def _send_events(self, states: 'queue.Queue[CellState]') -> None:
        beat = 0.0
        while not self.server.ending.is_set():
            try:
                state = states.get(timeout=0.2)
            except queue.Empty:
                beat += 0.2
                if beat >= _BEAT_S:
                    beat = 0.0
                    self.wfile.write(b': alive\n\n')
                continue
            beat = 0.0
            text = json.dumps(state.as_dict(), allow_nan=False)
            self.wfile.write(f'event: status\ndata: {text}\n\n'.encode())

    def _refuse(self, status: HTTPStatus, code: str, detail: str, **more: Any) -> None:
        self._send(status, {'code': code, 'detail': detail, **more})

    def _send(self, status: HTTPStatus, document: Any) -> None:
        data = json.dumps(document).encode()
        self.send_response(status)
        self.send_header('Content-Type', _JSON)
        self.send_header('Content-Length', str(len(data)))
        self.send_header('Cache-Control', 'no-store')
        self.end_headers()
        self.wfile.write(data)


def _is_address(host: str | None) -> bool:
    """Tell whether a Host is an IP address or localhost: a name may be one of another site."""
    name = re.sub(r':[0-9]+$', '', host or '').strip('[]')
    if name == 'localhost':
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _replace(states: 'queue.Queue[CellState]', state: CellState) -> None:
    """Put the newest state; the one that was not fetched is dropped."""
    while True:
        with contextlib.suppress(queue.Empty):
            states.get_nowait()
        with contextlib.suppress(queue.Full):
            states.put_nowait(state)
            return
