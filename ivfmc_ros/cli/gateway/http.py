# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc gateway http``: JSON requests, and server-sent events for the status."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import threading

import click

from ivfmc_ros.access_token import read_token
from ivfmc_ros.access_token import require_token
from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.cli.gateway.http_server import GatewayServer
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import ParameterError


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
    token = read_token(token_file)
    require_token(address, token, '--token-file')
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
