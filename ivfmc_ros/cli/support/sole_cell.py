# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Only one cell may run in a namespace: two would both answer."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
import hashlib
import os
import socket
import time

from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.errors import HelperError

# A cell that runs sends a heartbeat every 0.5 s.
_LISTEN_S = 1.0


@contextmanager
def sole_cell(client: CellClient) -> Iterator[None]:
    """
    Refuse another cell in the namespace of the client while the block runs.

    A cell on the same computer holds a lock; one on another computer, or started by
    ``ros2 launch``, is known by its heartbeats.

    :raises HelperError: nodes of a cell run in the namespace already
    """
    # An abstract socket needs no file, ends with its process, and, like DDS, belongs to the
    # network namespace. Its name is short, a namespace may be long: hence the hash.
    cell = f'{os.environ.get("ROS_DOMAIN_ID") or 0} {client.namespace}'
    name = hashlib.sha256(cell.encode()).hexdigest()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as lock:
        try:
            lock.bind(f'\0ivfmc_ros {name}')
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            raise _busy(client, 'ivfmc up or demo on this computer') from error
        # a killed node stays in the graph for a while, but sends no heartbeat
        with client.heartbeats() as beating:
            end = time.monotonic() + _LISTEN_S
            while time.monotonic() < end:
                client.spin(0.05)
            found = beating()
        if found:
            raise _busy(client, ', '.join(sorted(found)))
        yield


def _busy(client: CellClient, whose: str) -> HelperError:
    return HelperError(
        'BUSY',
        f'a cell is up in {client.namespace} already ({whose}); end it, '
        'or choose another --namespace or ROS_DOMAIN_ID',
    )
