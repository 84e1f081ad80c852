# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc gateway http``: JSON requests, and server-sent events for the status."""

from collections.abc import Iterator
from contextlib import contextmanager
import ipaddress
from pathlib import Path
import threading

import click

from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.cli.gateway.http_server import GatewayServer
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError

_MIN_TOKEN = 16


@click.command()
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
@click.option(
    '--address', default='127.0.0.1', show_default=True, help='Address to listen on, an IP.'
)
@click.option('--port', type=click.IntRange(0, 65535), default=8087, show_default=True)
@click.option(
    '--token-file',
    type=click.Path(path_type=Path),
    help='File with the token that clients send (Authorization: Bearer); needed for an address '
    'that other computers can reach.',
)
def http(namespace: str, address: str, port: int, token_file: Path | None) -> None:
    """
    Serve the scan service by HTTP.

    GET /status; GET /events (server-sent events); POST /start with the parameters of the scan as
    JSON; POST /cancel, /pause, /resume. No request names a path.
    """
    token = _token(token_file)
    if not _is_loopback(address) and not token:
        raise ParameterError(
            f'--address {address}: other computers can reach it; name a --token-file'
        )
    with cell_client(namespace_of(namespace)) as client, interrupted() as ending:
        gateway = CellGateway(client)
        with _serving(gateway, address, port, token) as server:
            console().print(f'http://{address}:{server.server_port}: cell {client.namespace}')
            gateway.run(ending)


@contextmanager
def _serving(gateway: CellGateway, address: str, port: int, token: str) -> Iterator[GatewayServer]:
    """:raises ParameterError: the address is taken or not of this computer."""
    try:
        server = GatewayServer((address, port), gateway, token)
    except OSError as error:
        raise ParameterError(f'--address {address} --port {port}: {error.strerror}') from error
    thread = threading.Thread(target=server.serve_forever, name='http', daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.close()
        thread.join()


def _token(path: Path | None) -> str:
    if path is None:
        return ''
    try:
        token = path.read_text(encoding='ascii').strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f'{path}: cannot be read as a token: {error}') from error
    if len(token) < _MIN_TOKEN or not token.isprintable():
        raise ParameterError(
            f'{path}: a token has at least {_MIN_TOKEN} printable characters; make one with '
            'openssl rand -hex 24'
        )
    return token


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        raise ParameterError(f'--address {address!r}: is no IP address') from None
