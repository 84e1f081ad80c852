# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The work window of a simulated cell, used in a browser as a person does."""

import os
from pathlib import Path
import signal
import socket
import time

import pytest
from rcl_interfaces.srv import GetParameters
from support.browser import browser
from support.browser import open_page
from support.small_cell import small_cell_options
import viser

from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.simulation.parts.solids import demo_part

# Screenshots, to be looked at.
SHOTS = Path(__file__).resolve().parents[2] / 'build' / 'window'
PORT = 8188
ADDRESS = f'http://127.0.0.1:{PORT}'
RECIPE = """
part: bracket
scan: {profiles: 100}
inspection: {nominal: demo.stl, tolerance: 0.2}
"""


@pytest.fixture(scope='module')
def recipes(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recipes')
    part = demo_part()
    write_solid(folder / 'demo.stl', part.vertices_xyz, part.faces)
    (folder / 'judged.yaml').write_text(RECIPE)
    return folder


@pytest.fixture(scope='module')
def cell(start_shared, tmp_path_factory, recipes):
    options = small_cell_options(tmp_path_factory.mktemp('small'))
    port = f'window.port={PORT}'
    yield start_shared(*options, '--recipes', recipes, '--window', '--set', port)


@pytest.fixture
def page(cell, client):
    SHOTS.mkdir(parents=True, exist_ok=True)
    # the nodes of a cell take long to start on a busy computer
    client.until(lambda: 'serving' in client.diagnostic('window'), 180.0, cell.log())
    with browser() as (page,):
        open_page(page, ADDRESS)
        button(page, 'Start scan').wait_for(timeout=120_000)
        client.until(lambda: 'connected' in client.diagnostic('turntable'), 60.0, cell.log())
        yield page
        assert page.errors == []
    if client.status and not value(client, 'result'):
        client.trigger('cancel')


def button(page, name):
    return page.get_by_role('button', name=name)


def tab(page, name):
    # the 3-D view is drawn by the processor here, so that a click takes long
    page.get_by_role('tab', name=name).click(timeout=60_000)


def value(client, key):
    return {item.key: item.value for item in client.status[-1].values}[key]


def shows(page, text, seconds=60.0):
    page.get_by_text(text).first.wait_for(timeout=1000 * seconds)


def fill(page, name, text):
    page.get_by_label(name, exact=True).first.fill(text)


def head(target, **headers):
    fields = {'Host': f'127.0.0.1:{PORT}', **headers}
    lines = ''.join(f'{name}: {text}\r\n' for name, text in fields.items())
    return f'GET {target} HTTP/1.1\r\n{lines}\r\n'.encode()


def exchange(target, **headers):
    """Send a request as it is, without what a client would mend, and return the response."""
    with socket.create_connection(('127.0.0.1', PORT), 30) as connection:
        connection.sendall(head(target, **headers))
        data = b''
        while chunk := connection.recv(65536):
            data += chunk
    return data


def flood(megabytes):
    """Send a WebSocket message of so many megabytes, as a page of this server does: in frames."""
    fields = {
        'Upgrade': 'websocket',
        'Connection': 'Upgrade',
        'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==',
        'Sec-WebSocket-Version': '13',
        'Sec-WebSocket-Protocol': f'viser-v{viser.__version__}',
    }
    with socket.create_connection(('127.0.0.1', PORT), 30) as connection:
        connection.sendall(head('/', **fields))
        assert connection.recv(65536).startswith(b'HTTP/1.1 101')
        size = 1_000_000
        for number in range(megabytes):
            # binary, then continuations; none is the last one, and the mask is 0
            opcode = b'\x00' if number else b'\x02'
            connection.sendall(opcode + b'\xff' + size.to_bytes(8, 'big') + bytes(4 + size))


def refused(client):
    """How many requests the window has refused, by its diagnostics."""
    return int(client.diagnostic('window').partition('refused: ')[2].partition(' ')[0] or 0)


def choose_recipe(page, name):
    page.get_by_label('Recipe', exact=True).first.click(timeout=60_000)
    page.get_by_role('option', name=name).click(timeout=60_000)


def start_scan(page, client, profiles):
    if page.get_by_label('Profiles', exact=True).first.is_disabled():
        # a recipe that an earlier test chose gives the number
        choose_recipe(page, '(none)')
    fill(page, 'Profiles', str(profiles))
    before = value(client, 'scan_id')
    button(page, 'Start scan').click(timeout=60_000)
    client.until(lambda: value(client, 'scan_id') != before, 30.0, 'no scan was started')


def test_scan_is_started_followed_and_cancelled(page, client, cell):
    client.until(lambda: client.status, 60.0, cell.log())
    start_scan(page, client, 100)
    shows(page, 'scanning:')
    client.until(lambda: int(value(client, 'profiles_done') or 0) > 20, 60.0, cell.log())
    page.screenshot(path=SHOTS / 'scanning.png')
    tab(page, 'Work')
    shows(page, 'rows:')
    page.screenshot(path=SHOTS / 'work.png')
    tab(page, 'Scan')
    button(page, 'Cancel').click(timeout=60_000)
    client.until(lambda: value(client, 'code') == 'CANCELLED', 10.0, cell.log())
    shows(page, 'CANCELLED')
    # what one caller set is not left for the next one
    request = GetParameters.Request(names=['profiles'])
    answer = client.call(GetParameters, 'orchestrator/get_parameters', request)
    assert answer.values[0].integer_value != 100


@pytest.mark.slow
def test_scan_is_paused_and_resumed_and_ends_with_a_mesh(page, client, cell):
    start_scan(page, client, 100)
    shows(page, 'scanning:')
    client.until(lambda: int(value(client, 'profiles_done') or 0) > 5, 60.0, cell.log())
    button(page, 'Pause').click(timeout=60_000)
    shows(page, 'paused, laser off', 90.0)
    button(page, 'Resume').click(timeout=60_000)
    client.until(lambda: value(client, 'stage') == 'DONE', 180.0, cell.log())
    shows(page, 'done')
    page.wait_for_timeout(5000)
    page.screenshot(path=SHOTS / 'done.png')
    tab(page, 'History')
    button(page, 'List again').click(timeout=60_000)
    page.screenshot(path=SHOTS / 'history.png')


@pytest.mark.slow
def test_scan_by_a_recipe_ends_with_its_verdict_and_deviations(page, client, cell):
    before = value(client, 'scan_id')
    choose_recipe(page, 'judged')
    shows(page, 'judged by')
    button(page, 'Start scan').click(timeout=60_000)
    client.until(lambda: value(client, 'scan_id') != before, 30.0, 'no scan was started')
    client.until(lambda: value(client, 'stage') == 'DONE', 300.0, cell.log())
    # the simulated cell states no covariance
    assert value(client, 'verdict') == 'no uncertainty known'
    shows(page, 'NO UNCERTAINTY KNOWN')
    page.screenshot(path=SHOTS / 'verdict.png')
    tab(page, '3-D')
    shows(page, 'tolerance ±0.200')
    page.wait_for_timeout(3000)
    page.screenshot(path=SHOTS / 'deviation.png')
    tab(page, 'Calibrate')
    page.screenshot(path=SHOTS / 'calibrate.png')


@pytest.mark.slow
def test_scan_goes_on_while_the_page_is_abused(client, cell):
    """10,000 requests of another origin, paths, and a message of 100 MB."""
    client.until(lambda: 'serving' in client.diagnostic('window'), 180.0, cell.log())
    client.until(lambda: 'publishing' in client.diagnostic('camera'), 60.0, cell.log())
    assert client.set('orchestrator', profiles=100, recipe='').successful
    success, started = client.trigger('start_scan')
    assert success, started
    for _ in range(10_000):
        answer = exchange('/', Origin='http://evil.example')
        assert answer.startswith(b'HTTP/1.1 403')
    for path in ('/../../../../etc/passwd', '/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd'):
        assert b'root:' not in exchange(path)
    with pytest.raises(OSError):
        flood(100)
    client.until(lambda: value(client, 'stage') in ('DONE', 'FAILED'), 300.0, cell.log())
    assert value(client, 'scan_id') == started['scan_id']
    assert value(client, 'code') == 'OK'
    # the diagnostics come once a second
    client.until(lambda: refused(client) > 10_000, 10.0, cell.log())
    assert 'a page of another origin' in cell.log()
    assert 'a message that is too large' in cell.log()


@pytest.mark.slow
def test_camera_that_is_killed_is_shown_within_three_seconds(page, client, cell):
    start_scan(page, client, 200)
    client.until(lambda: int(value(client, 'profiles_done') or 0) > 5, 60.0, cell.log())
    os.kill(cell.id_of('camera'), signal.SIGKILL)
    begin = time.monotonic()
    shows(page, 'CAMERA_LOST', 10.0)
    assert time.monotonic() - begin < 3.0
    page.screenshot(path=SHOTS / 'camera_lost.png')


@pytest.mark.slow
def test_window_that_is_killed_costs_no_profile_and_comes_back(page, client, cell):
    client.until(lambda: 'publishing' in client.diagnostic('camera'), 60.0, cell.log())
    start_scan(page, client, 100)
    client.until(lambda: int(value(client, 'profiles_done') or 0) > 5, 60.0, cell.log())
    os.kill(cell.id_of('window'), signal.SIGKILL)
    client.until(lambda: value(client, 'stage') in ('DONE', 'FAILED'), 180.0, cell.log())
    assert value(client, 'code') == 'OK'
    open_page(page, ADDRESS)
    shows(page, 'done')
    # the connection to the window that died
    page.errors.clear()
