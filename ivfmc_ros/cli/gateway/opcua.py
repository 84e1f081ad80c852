# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc gateway opcua``: an OPC UA server with the scan service of a cell."""

import os
from pathlib import Path
import re

import click

from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.cli.support.cell_run import make_folder
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError

PASSWORD = 'IVFMC_GATEWAY_PASSWORD'
_MIN_PASSWORD = 8
_ENDPOINT = re.compile(r'opc\.tcp://[A-Za-z0-9.:\[\]-]+:[0-9]{1,5}(/[A-Za-z0-9_./-]*)?')


@click.command()
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
@click.option(
    '--endpoint', default='opc.tcp://127.0.0.1:4840/ivfmc', show_default=True, metavar='URL'
)
@click.option('--user', help=f'Name of the user; the password is in {PASSWORD}.')
@click.option('--anonymous', is_flag=True, help='Let clients in without a name.')
@click.option(
    '--folder',
    type=click.Path(path_type=Path),
    default=Path('ivfmc_run/gateway'),
    show_default=True,
    help='Folder of certificate.der and key.pem; a self-signed pair is made where there is none.',
)
def opcua(namespace: str, endpoint: str, user: str | None, anonymous: bool, folder: Path) -> None:
    """
    Serve the scan service by OPC UA (Basic256Sha256, signed and encrypted).

    The object Cell has the state of the cell and of the scan as variables, the methods Start,
    Cancel, Pause and Resume, and the event ScanEnded.
    """
    if not _ENDPOINT.fullmatch(endpoint):
        raise ParameterError(f'--endpoint {endpoint!r}: must be opc.tcp://HOST:PORT/PATH')
    users = _users(user, anonymous)
    try:
        from ivfmc_ros.cli.gateway.opcua_server import serving
    except ImportError as error:
        raise HelperError(
            'NOT_STARTED', f'asyncua is needed: pip install ivfmc_ros[opcua] ({error})'
        ) from error
    make_folder(folder)
    with cell_client(namespace_of(namespace)) as client, interrupted() as ending:
        gateway = CellGateway(client)
        with serving(gateway, endpoint, users, folder, anonymous=anonymous):
            console().print(f'{endpoint}: cell {client.namespace}')
            gateway.run(ending)


def _users(user: str | None, anonymous: bool) -> dict[str, str]:
    """Return the password of each user."""
    password = os.environ.get(PASSWORD, '')
    if user is None:
        if not anonymous:
            raise ParameterError(f'--user NAME, with its password in {PASSWORD}, or --anonymous')
        return {}
    if len(password) < _MIN_PASSWORD:
        raise ParameterError(f'{PASSWORD}: must have {_MIN_PASSWORD} characters or more')
    return {user: password}
