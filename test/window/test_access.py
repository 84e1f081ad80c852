# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.errors import MessageError
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.access import COOKIE
from ivfmc_ros.window.access import parse_head

TOKEN = '0123456789abcdef'


def head(target='/', method='GET', host='127.0.0.1:8088', **headers):
    lines = [f'{method} {target} HTTP/1.1', f'Host: {host}']
    lines += [f'{name}: {value}' for name, value in headers.items()]
    return parse_head('\r\n'.join([*lines, '', '']).encode())


@pytest.mark.parametrize('host', ['127.0.0.1:8088', 'localhost:8088', '[::1]:8088', 'localhost'])
def test_browser_of_this_computer_is_let_in(host):
    assert Access().refusal(head(host=host)) is None
    assert Access().refusal(head(host=host, Origin=f'http://{host}')) is None


@pytest.mark.parametrize(
    ('request_head', 'status'),
    [
        (head(host='evil.example'), '403'),
        (head(host='127.0.0.1.evil.example:8088'), '403'),
        (head(host='[bad'), '403'),
        (head(host=''), '403'),
        (head(Origin='http://evil.example'), '403'),
        (head(Origin='null'), '403'),
        (head(Origin='http://127.0.0.1:9999'), '403'),
        (head(method='POST'), '405'),
    ],
)
def test_other_pages_and_names_are_refused(request_head, status):
    for access in (Access(), Access(token=TOKEN)):
        refusal = access.refusal(request_head)
        # with a token any host name may be meant, but then the token is missing
        assert refusal.status.startswith((status, '401'))
        assert refusal.reason


def test_token_becomes_a_cookie_that_opens_the_page():
    access = Access(token=TOKEN)
    asked = access.refusal(head())
    assert asked.status.startswith('401')
    assert b'<form' in asked.encode()
    redirect = access.refusal(head(f'/?token={TOKEN}'))
    assert redirect.status.startswith('303')
    cookie = redirect.headers['Set-Cookie']
    assert 'HttpOnly' in cookie
    assert 'SameSite=Strict' in cookie
    # the token is not in the address any more
    assert redirect.headers['Location'] == '/'
    assert access.refusal(head(Cookie=cookie.split(';')[0])) is None


@pytest.mark.parametrize(
    'wrong',
    [
        head('/?token='),
        head('/?token=0123456789abcdeF'),
        head(Cookie=f'{COOKIE}=wrong'),
        head(Cookie='token=0123456789abcdef'),
        head(Cookie='\x00=;;;'),
    ],
)
def test_wrong_token_is_refused(wrong):
    assert Access(token=TOKEN).refusal(wrong).status.startswith('401')


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'GET /\r\n\r\n',
        b'GET / HTTP/2\r\n\r\n',
        b'GET http://x/ HTTP/1.1\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost : a\r\n\r\n',
        b'\xff\xfe\x00',
    ],
)
def test_what_is_no_request_is_refused(data):
    with pytest.raises(MessageError):
        parse_head(data)
