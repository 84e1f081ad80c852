# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reverse proxy in front of the page: checks each request, then forwards its connection."""

import asyncio
from collections import Counter
from collections.abc import Callable
import contextlib
import threading
import time

from ivfmc_ros.errors import MessageError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.access import MAX_HEAD
from ivfmc_ros.window.access import parse_head
from ivfmc_ros.window.access import Refusal
from ivfmc_ros.window.access import RequestHead

# Connections at a time; a browser holds one and opens some while it loads the page.
_MAX_CONNECTIONS = 64
# Seconds for the head of a request.
_HEAD_S = 5.0
# Bytes that a browser may send within a period, seconds: it sends clicks and camera poses.
_MAX_SENT, _PERIOD_S = 4_000_000, 10.0
_CHUNK = 65_536
# Seconds between two lines of the log for one kind of refusal.
_LOG_S = 10.0
_STOP_S = 5.0

_BUSY = Refusal(
    status='503 Service Unavailable', headers={}, body='too many connections', reason='a crowd'
)
_BAD = Refusal(status='400 Bad Request', headers={}, body='bad request', reason='no HTTP request')


class Gate:
    """
    Listens on an address, in a thread of its own.

    port : that it listens on
    refused : requests that were refused, by reason
    """

    def __init__(
        self,
        address: str,
        port: int,
        inner_port: int,
        access: Access,
        log: Callable[[str], object],
    ) -> None:
        """
        Listen.

        port : 0 for a free one
        inner_port : of the page, on the loopback interface
        log : called with a line for each kind of refusal, now and then
        :raises ParameterError: the address is taken, or not of this computer
        """
        self.refused: Counter[str] = Counter()
        self._inner_port, self._access, self._log = inner_port, access, log
        self._logged: dict[str, tuple[float, int]] = {}
        self._open = 0
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(
                asyncio.start_server(self._serve, address, port, limit=MAX_HEAD)
            )
        except OSError as error:
            self._loop.close()
            raise ParameterError(
                f'address {address}, port {port}: {error.strerror or error}'
            ) from error
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, name='gate', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close all connections and end the thread."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(_STOP_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_STOP_S)
        self._loop.close()

    async def _close(self) -> None:
        self._server.close()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            # a browser that goes away in the middle is no fault
            with contextlib.suppress(ConnectionError, TimeoutError, asyncio.IncompleteReadError):
                await self._handle(reader, writer)
        finally:
            self._open -= 1
            writer.close()

    async def _handle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._open > _MAX_CONNECTIONS:
            await self._refuse(writer, _BUSY)
            return
        try:
            async with asyncio.timeout(_HEAD_S):
                data = await reader.readuntil(b'\r\n\r\n')
            head = parse_head(data)
        except (MessageError, asyncio.LimitOverrunError):
            await self._refuse(writer, _BAD)
            return
        refusal = self._access.refusal(head)
        if refusal is not None:
            await self._refuse(writer, refusal)
            return
        inner_reader, inner_writer = await asyncio.open_connection('127.0.0.1', self._inner_port)
        try:
            inner_writer.write(_forwarded(head))
            back = asyncio.create_task(_pipe(inner_reader, writer))
            # only a WebSocket goes on: the next request of a kept connection would pass unchecked
            forth = asyncio.create_task(self._limited(reader, inner_writer, head))
            await asyncio.wait((back, forth), return_when=asyncio.FIRST_COMPLETED)
            for task in (back, forth):
                task.cancel()
            await asyncio.gather(back, forth, return_exceptions=True)
        finally:
            inner_writer.close()

    async def _limited(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, head: RequestHead
    ) -> None:
        """Forward what a browser sends, until it sends too much."""
        if not head.upgrades:
            # nothing follows a GET
            await asyncio.Event().wait()
        begin, sent = time.monotonic(), 0
        while data := await reader.read(_CHUNK):
            now = time.monotonic()
            if now - begin > _PERIOD_S:
                begin, sent = now, 0
            sent += len(data)
            if sent > _MAX_SENT:
                self._count('a message that is too large')
                return
            writer.write(data)
            await writer.drain()

    async def _refuse(self, writer: asyncio.StreamWriter, refusal: Refusal) -> None:
        if refusal.reason:
            self._count(refusal.reason)
        writer.write(refusal.encode())
        await writer.drain()

    def _count(self, reason: str) -> None:
        self.refused[reason] += 1
        last_s, counted = self._logged.get(reason, (-_LOG_S, 0))
        now = time.monotonic()
        if now - last_s >= _LOG_S:
            number = self.refused[reason] - counted
            self._logged[reason] = now, self.refused[reason]
            self._log(f'refused {number} request{"s" * (number > 1)}: {reason}')


def _forwarded(head: RequestHead) -> bytes:
    """Return the head as the page gets it: without cookie, and one request a connection."""
    headers = {name: value for name, value in head.headers.items() if name != 'cookie'}
    if not head.upgrades:
        headers['connection'] = 'close'
    lines = [f'GET {head.target} HTTP/1.1', *(f'{name}: {v}' for name, v in headers.items())]
    return '\r\n'.join([*lines, '', '']).encode('latin-1')


async def _pipe(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_CHUNK):
        writer.write(data)
        await writer.drain()
