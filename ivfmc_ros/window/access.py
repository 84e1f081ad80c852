# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Decides by the head of an HTTP request whether a browser may see the page.

Three things are refused: a request without the token, where one is set; a page of another origin
that opens a connection in the background (cross-site WebSocket hijacking); and on the loopback
interface a host name that is none of this computer (DNS rebinding). Browsers send ``Origin`` and
``Host`` by themselves, and no script can change them (Fetch standard, forbidden request headers).
"""

from collections.abc import Mapping
from dataclasses import dataclass
import hmac
from http.cookies import CookieError
from http.cookies import SimpleCookie
from urllib.parse import parse_qs
from urllib.parse import urlsplit

from ivfmc_ros.errors import MessageError

# Longest head of a request, bytes: browsers send about 1 kB.
MAX_HEAD = 16_384
COOKIE = 'ivfmc_window'
_LOOPBACK = ('localhost', '127.0.0.1', '::1')
_ASK = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>ivfmc</title></head>
<body style="font-family:sans-serif;margin:4em auto;max-width:30em">
<h1>Work window</h1><p>This cell asks for the token of its operator.</p>
<form method="get" action="/"><label>Token <input type="password" name="token" required></label>
<button type="submit">Open</button></form></body></html>"""


@dataclass(frozen=True, kw_only=True)
class RequestHead:
    """
    The head of an HTTP request.

    target : path with query
    headers : by lower-case name
    """

    method: str
    target: str
    headers: Mapping[str, str]

    @property
    def upgrades(self) -> bool:
        """Whether the request opens a WebSocket."""
        return self.headers.get('upgrade', '').lower() == 'websocket'


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """
    The response to a request that is not forwarded.

    reason : for the log; empty for a response that is normal
    """

    status: str
    headers: Mapping[str, str]
    body: str
    reason: str

    def encode(self) -> bytes:
        """Return the response as bytes."""
        body = self.body.encode()
        lines = [f'HTTP/1.1 {self.status}']
        fixed = {
            'Content-Type': 'text/html; charset=utf-8',
            'Content-Length': str(len(body)),
            'Cache-Control': 'no-store',
            'Connection': 'close',
        }
        lines += [f'{name}: {value}' for name, value in {**fixed, **self.headers}.items()]
        return '\r\n'.join([*lines, '', '']).encode('latin-1') + body


def parse_head(data: bytes) -> RequestHead:
    """
    Parse the head of a request, up to and with its empty line.

    :raises MessageError: it is no HTTP/1.1 request
    """
    try:
        first, *lines = data.decode('latin-1').split('\r\n')
        method, target, version = first.split(' ')
        headers = {}
        for line in lines:
            if line:
                name, colon, value = line.partition(':')
                if not colon or name != name.strip() or name.lower() in headers:
                    raise ValueError(line)
                headers[name.lower()] = value.strip()
    except ValueError:
        raise MessageError('is no HTTP request') from None
    if not version.startswith('HTTP/1.') or not target.startswith('/'):
        raise MessageError('is no HTTP/1.1 request')
    return RequestHead(method=method, target=target, headers=headers)


@dataclass(frozen=True, kw_only=True)
class Access:
    """
    Who may see the page.

    token : that a browser has to show; '' for none
    """

    token: str = ''

    def refusal(self, head: RequestHead) -> Refusal | None:
        """Return the response to a request that is refused or redirected; None to forward it."""
        fault = self._fault(head)
        if fault is not None:
            return fault
        if not self.token or self._has_cookie(head):
            return None
        given = parse_qs(urlsplit(head.target).query).get('token', [''])[0]
        if not self._is_token(given):
            reason = 'a wrong token' if given else 'no token'
            return _refused('401 Unauthorized', reason, _ASK)
        return Refusal(
            status='303 See Other',
            # not readable by scripts, not sent by pages of other origins
            headers={
                'Location': '/',
                'Set-Cookie': f'{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/',
            },
            body='',
            reason='',
        )

    def _fault(self, head: RequestHead) -> Refusal | None:
        """Return the response to a request that no token makes good."""
        if head.method != 'GET':
            return _refused('405 Method Not Allowed', f'method {head.method[:16]}')
        host = head.headers.get('host', '')
        if not self.token and _name_of(host) not in _LOOPBACK:
            return _refused('403 Forbidden', 'a host name that is not of this computer')
        origin = head.headers.get('origin')
        if origin is not None and origin.partition('://')[2] != host:
            return _refused('403 Forbidden', 'a page of another origin')
        return None

    def _has_cookie(self, head: RequestHead) -> bool:
        try:
            cookie = SimpleCookie(head.headers.get('cookie', '')).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and self._is_token(cookie.value)

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self.token.encode())


def _name_of(host: str) -> str:
    try:
        return urlsplit(f'//{host}').hostname or ''
    except ValueError:
        return ''


def _refused(status: str, reason: str, body: str = '') -> Refusal:
    return Refusal(status=status, headers={}, body=body or status, reason=reason)
