# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The OPC UA gateway, driven by the client of asyncua."""

import asyncio
import json
import socket

import pytest
from support.gateway_rig import CellWithoutRos
from support.gateway_rig import gateway_of

pytest.importorskip('asyncua')
from asyncua import Client
from asyncua import ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from ivfmc_ros.cli.gateway.opcua_server import NAMESPACE_URI
from ivfmc_ros.cli.gateway.opcua_server import serving
from ivfmc_ros.errors import HelperError

PASSWORD = 'correct horse'


@pytest.fixture
def cell():
    return CellWithoutRos()


@pytest.fixture
def served(cell, tmp_path):
    """Serve the cell; yields the endpoint and the folder of the certificates."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    endpoint = f'opc.tcp://127.0.0.1:{port}/ivfmc'
    with gateway_of(cell) as gateway, serving(gateway, endpoint, {'plc': PASSWORD}, tmp_path):
        yield endpoint, tmp_path


class Cell:
    """The object Cell as a client sees it."""

    def __init__(self, client, node, index):
        self.client, self.node, self._index = client, node, index

    async def child(self, name):
        return await self.node.get_child(f'{self._index}:{name}')

    async def value(self, name):
        return await (await self.child(name)).read_value()

    async def call(self, name, *arguments):
        return await self.node.call_method(f'{self._index}:{name}', *arguments)

    async def await_value(self, name, wanted):
        for _ in range(200):
            if await self.value(name) == wanted:
                return
            await asyncio.sleep(0.05)
        raise AssertionError(f'{name} is {await self.value(name)}')


def run(served, work, user='plc', password=PASSWORD):
    endpoint, folder = served

    async def session():
        client = Client(endpoint)
        client.set_user(user)
        client.set_password(password)
        await client.set_security(
            SecurityPolicyBasic256Sha256,
            certificate=str(folder / 'certificate.der'),
            private_key=str(folder / 'key.pem'),
            server_certificate=str(folder / 'certificate.der'),
        )
        client.application_uri = 'urn:ivfmc_ros:gateway'
        async with client:
            index = await client.get_namespace_index(NAMESPACE_URI)
            node = await client.nodes.objects.get_child(f'{index}:Cell')
            return await work(Cell(client, node, index))

    return asyncio.run(asyncio.wait_for(session(), 60.0))


def test_scan_is_started_followed_and_ended(cell, served):
    async def work(remote):
        events = Events()
        subscription = await remote.client.create_subscription(100, events)
        kind = await remote.client.nodes.base_event_type.get_child(f'{remote._index}:ScanEnded')
        await subscription.subscribe_events(remote.node, kind)
        values = {'part': 'bracket', 'profiles': 400}
        assert await remote.call('Start', json.dumps(values)) == ['OK', 'scan_1', '']
        assert cell.calls == [('start_scan', values)]
        await remote.await_value('Stage', 'SCANNING')
        assert await remote.value('ProfilesTotal') == 400
        assert await remote.value('EtaSeconds') == 12.5
        assert await remote.value('Alive') is True
        assert await remote.call('Pause') == ['OK', '']
        cell.finish(verdict='fail')
        await remote.await_value('Verdict', 'fail')
        assert json.loads(await remote.value('Result'))['scan_id'] == 'scan_1'
        event = await asyncio.wait_for(events.first, 20.0)
        assert (event.ScanId, event.Code, event.Verdict) == ('scan_1', 'OK', 'fail')

    run(served, work)


class Events:
    def __init__(self):
        self.first = asyncio.get_running_loop().create_future()

    def event_notification(self, event):
        if not self.first.done():
            self.first.set_result(event)


@pytest.mark.parametrize(
    ('method', 'arguments', 'code'),
    [
        ('Start', ['{'], 'BAD_PARAMETER'),
        ('Start', ['[1]'], 'BAD_PARAMETER'),
        ('Start', ['{"cell": "/etc/passwd"}'], 'BAD_PARAMETER'),
        ('Cancel', [], 'WRONG_STATE'),
        ('Resume', [], 'WRONG_STATE'),
    ],
)
def test_call_that_cannot_be_done_has_a_code(served, method, arguments, code):
    answer = run(served, lambda remote: remote.call(method, *arguments))
    assert answer[0] == code
    assert answer[-1]


def test_clients_write_no_variable(served):
    async def work(remote):
        node = await remote.child('Stage')
        with pytest.raises(ua.UaStatusCodeError):
            await node.write_value('DONE')

    run(served, work)


@pytest.mark.parametrize(('user', 'password'), [('plc', 'wrong'), ('other', PASSWORD)])
def test_unknown_user_gets_no_session(served, user, password):
    with pytest.raises(ua.UaError):
        run(served, lambda remote: remote.value('Stage'), user, password)


def test_client_without_encryption_or_name_gets_nothing(served):
    async def session():
        async with Client(served[0]) as client:
            return await client.nodes.objects.get_children()

    with pytest.raises((ua.UaError, ValueError)):
        asyncio.run(asyncio.wait_for(session(), 30.0))


def test_port_that_is_taken_is_named(cell, tmp_path):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        endpoint = f'opc.tcp://127.0.0.1:{taken.getsockname()[1]}/ivfmc'
        with (
            gateway_of(cell) as gateway,
            pytest.raises(HelperError, match='already in use'),
            serving(gateway, endpoint, {'plc': PASSWORD}, tmp_path),
        ):
            pass
