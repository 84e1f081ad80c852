# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""OPC UA server of a ``CellGateway`` (asyncua), in a thread with its own event loop."""

import asyncio
from collections.abc import Iterator
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import contextmanager
import hmac
import json
from pathlib import Path
import socket
import threading
from typing import Any

from asyncua import ua
from asyncua.common.methods import uamethod
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.permission_rules import SimpleRoleRuleset
from asyncua.crypto.permission_rules import User
from asyncua.crypto.permission_rules import UserRole
from asyncua.server.server import Server
from cryptography.x509.oid import ExtendedKeyUsageOID

from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.cli.gateway.cell_gateway import CellState
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ScanError

NAMESPACE_URI = 'urn:ivfmc_ros:cell'
_APPLICATION_URI = 'urn:ivfmc_ros:gateway'
# Seconds for the start of the server, and for an answer of the cell.
_START_S, _ANSWER_S = 60.0, 40.0
# Variables of the object Cell, with the values of scan_status that they show.
_TEXTS = {'Stage': 'stage', 'ScanId': 'scan_id', 'Code': 'code', 'Verdict': 'verdict'}
_COUNTS = {
    'ViewsDone': 'views_done',
    'ViewsTotal': 'views_total',
    'ProfilesDone': 'profiles_done',
    'ProfilesTotal': 'profiles_total',
}


@contextmanager
def serving(
    gateway: CellGateway,
    endpoint: str,
    users: Mapping[str, str],
    folder: Path,
    *,
    anonymous: bool = False,
) -> Iterator[None]:
    """
    Serve a gateway while the block runs.

    users : password of each user
    folder : of certificate and key
    :raises HelperError: NOT_STARTED, with the reason
    """
    server = _CellServer(gateway, endpoint, users, folder, anonymous)
    thread = threading.Thread(target=server.run, name='opcua', daemon=True)
    thread.start()
    try:
        server.started.result(_START_S)
    except Exception as error:
        server.end()
        raise HelperError('NOT_STARTED', f'{endpoint}: {type(error).__name__} {error}') from error
    try:
        yield
    finally:
        server.end()
        thread.join(_START_S)


class _Users:
    """Lets known users in; the others get no session."""

    def __init__(self, passwords: Mapping[str, str], anonymous: bool) -> None:
        self._passwords, self._anonymous = passwords, anonymous

    def get_user(
        self, _: Any, username: str | None = None, password: str | None = None, **__: Any
    ) -> User | None:
        """Return the user of a session, None for one that is refused."""
        user = User(role=UserRole.User, name=username)
        if username is None:
            return user if self._anonymous else None
        known = self._passwords.get(username)
        if known is None or password is None:
            return None
        return user if hmac.compare_digest(known.encode(), password.encode()) else None


class _CellServer:
    """
    The server.

    started : done when clients can connect
    """

    def __init__(
        self,
        gateway: CellGateway,
        endpoint: str,
        users: Mapping[str, str],
        folder: Path,
        anonymous: bool,
    ) -> None:
        self._gateway, self._endpoint, self._folder = gateway, endpoint, folder
        self._users, self._anonymous = _Users(users, anonymous), anonymous
        self.started: Future[None] = Future()
        self._loop = asyncio.new_event_loop()
        self._changed = asyncio.Event()
        self._ending = False
        self._variables: dict[str, Any] = {}
        self._announced = ''

    def run(self) -> None:
        """Serve until ``end`` is called; for a thread of its own."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:  # raised where the start is awaited
            if not self.started.done():
                self.started.set_exception(error)
        finally:
            self._loop.close()

    def end(self) -> None:
        """End the server; for any thread."""
        self._ending = True
        self._wake()

    def _wake(self) -> None:
        # a loop that has ended needs no call
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._changed.set)

    async def _serve(self) -> None:
        server = Server(user_manager=self._users)  # type: ignore[arg-type]
        await server.init()
        server.set_endpoint(self._endpoint)
        server.set_server_name('ivfmc_ros gateway')
        await server.set_application_uri(_APPLICATION_URI)
        await self._secure(server)
        ended = await self._add_cell(server)
        async with server:
            end_listening = self._gateway.listen(lambda _: self._wake())
            self.started.set_result(None)
            try:
                while not self._ending:
                    await self._changed.wait()
                    self._changed.clear()
                    await self._publish(self._gateway.state, ended)
            finally:
                end_listening()

    async def _secure(self, server: Server) -> None:
        certificate, key = self._folder / 'certificate.der', self._folder / 'key.pem'
        await setup_self_signed_certificate(
            key,
            certificate,
            _APPLICATION_URI,
            socket.gethostname(),
            [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH],
            {'organizationName': 'ivfmc_ros'},
        )
        key.chmod(0o600)
        server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt],
            permission_ruleset=SimpleRoleRuleset(),  # type: ignore[no-untyped-call]
        )
        tokens: list[type] = [ua.UserNameIdentityToken]
        server.set_identity_tokens([*tokens, *[ua.AnonymousIdentityToken] * self._anonymous])
        await server.load_certificate(certificate)
        await server.load_private_key(key)

    async def _add_cell(self, server: Server) -> Any:
        """Add the object Cell; returns the generator of its event."""
        index = await server.register_namespace(NAMESPACE_URI)
        cell = await server.nodes.objects.add_object(index, 'Cell')
        initial: dict[str, Any] = {
            'Alive': False,
            **dict.fromkeys(_TEXTS, ''),
            'Result': '',
            'EtaSeconds': 0.0,
        }
        for name, value in initial.items():
            self._variables[name] = await cell.add_variable(index, name, value)
        for name in _COUNTS:
            self._variables[name] = await cell.add_variable(
                index, name, 0, varianttype=ua.VariantType.UInt32
            )
        text = ua.VariantType.String
        await cell.add_method(index, 'Start', self._start, [text], [text, text, text])
        for name in ('Cancel', 'Pause', 'Resume'):
            await cell.add_method(index, name, self._method(name.lower()), [], [text, text])
        kind = await server.create_custom_event_type(
            index, 'ScanEnded', properties=[(name, text) for name in ('ScanId', 'Code', 'Verdict')]
        )
        return await server.get_event_generator(kind, cell.nodeid)

    @property
    def _start(self) -> Any:
        @uamethod
        async def start(_: Any, parameters: str) -> tuple[str, str, str]:
            """Start a scan; ``parameters`` is a JSON object or empty. Code, scan id, detail."""
            try:
                values = json.loads(parameters) if parameters and parameters.strip() else {}
            except ValueError as error:
                return 'BAD_PARAMETER', '', f'Parameters: is not JSON: {error}'
            if not isinstance(values, dict):
                return 'BAD_PARAMETER', '', 'Parameters: must be a JSON object'
            code, detail, answer = await self._ask('start', values)
            return code, str(answer.get('scan_id', '')), detail

        return start

    def _method(self, action: str) -> Any:
        @uamethod
        async def method(_: Any) -> tuple[str, str]:
            """Code and detail."""
            code, detail, _answer = await self._ask(action, {})
            return code, detail

        return method

    async def _ask(
        self, action: str, values: Mapping[str, Any]
    ) -> tuple[str, str, Mapping[str, Any]]:
        try:
            future = self._gateway.request(action, values)
            answer = await asyncio.wait_for(asyncio.wrap_future(future), _ANSWER_S)
        except TimeoutError:
            return 'TIMEOUT', f'the cell did not answer within {_ANSWER_S:.0f} s', {}
        except ScanError as error:
            return error.code, str(error), {}
        return 'OK', '', answer

    async def _publish(self, state: CellState, ended: Any) -> None:
        status = state.status
        await self._write('Alive', state.alive)
        for name, key in _TEXTS.items():
            await self._write(name, str(status.get(key, '')))
        for name, key in _COUNTS.items():
            await self._write(name, ua.Variant(_count(status, key), ua.VariantType.UInt32))
        await self._write('EtaSeconds', float(status.get('eta_s') or 0.0))
        result = status.get('result')
        await self._write('Result', json.dumps(result) if result else '')
        scan_id = str(status.get('scan_id', ''))
        if result and scan_id != self._announced:
            self._announced = scan_id
            ended.event.ScanId, ended.event.Code = scan_id, str(status.get('code', ''))
            ended.event.Verdict = str(status.get('verdict', ''))
            await ended.trigger(message=f'scan {scan_id} ended: {status.get("code", "")}')

    async def _write(self, name: str, value: Any) -> None:
        await self._variables[name].write_value(value)


def _count(status: Mapping[str, Any], key: str) -> int:
    text = str(status.get(key, ''))
    return int(text) if text.isdecimal() else 0
