# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A PostgreSQL server of the tests' own, in a temporary folder, on a free port of this machine."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import socket
import subprocess
import tempfile
import time

# Debian has the programs of each version in a folder of its own.
_DEBIAN = Path('/usr/lib/postgresql')
# Seconds until the server must answer; a busy machine is slow.
_START_S = 120.0
# Limit of connections; 64 writers at once and the pools of the test.
_CONNECTIONS = 200


def programs() -> Path | None:
    """Return the folder of initdb and postgres, None where PostgreSQL is not installed."""
    folders = sorted(_DEBIAN.glob('*/bin'), reverse=True)
    found = shutil.which('initdb')
    folders += [Path(found).parent] if found else []
    return next((path for path in folders if (path / 'initdb').exists()), None)


class Server:
    """A server; ``stop`` and ``start`` may be called again and again."""

    def __init__(self, folder: Path, bin_folder: Path) -> None:
        self._data = folder / 'data'
        self._bin = bin_folder
        self._log = folder / 'log'
        # the server refuses to run as root
        self._user = {'user': 'postgres', 'group': 'postgres'} if os.geteuid() == 0 else {}
        self._process: subprocess.Popen[bytes] | None = None
        self.port = _free_port()
        if self._user:
            shutil.chown(folder, 'postgres', 'postgres')
        subprocess.run(
            [self._bin / 'initdb', '-D', self._data, '--no-sync', '-A', 'trust', '-U', 'ivfmc',
             '-E', 'UTF8', '--locale=C'],
            check=True, capture_output=True, cwd=folder, **self._user,
        )  # fmt: skip

    @property
    def url(self) -> str:
        return f'postgresql+psycopg://ivfmc@127.0.0.1:{self.port}/postgres'

    def start(self) -> None:
        options = {
            'port': self.port,
            'listen_addresses': '127.0.0.1',
            'unix_socket_directories': '',
            'fsync': 'off',
            'max_connections': _CONNECTIONS,
        }
        settings = [part for name, value in options.items() for part in ('-c', f'{name}={value}')]
        with self._log.open('ab') as log:
            self._process = subprocess.Popen(
                [self._bin / 'postgres', '-D', self._data, *settings],
                stdout=log, stderr=log, cwd=self._data.parent, **self._user,
            )  # fmt: skip
        self._wait()

    def stop(self) -> None:
        """End the server at once, as a power cut of its machine does."""
        if self._process is not None:
            self._process.send_signal(signal.SIGQUIT)
            self._process.wait(60.0)
            self._process = None

    def _wait(self) -> None:
        import psycopg

        deadline = time.monotonic() + _START_S
        while True:
            try:
                psycopg.connect(
                    host='127.0.0.1', port=self.port, user='ivfmc', dbname='postgres'
                ).close()
            except psycopg.OperationalError:
                if time.monotonic() > deadline:
                    raise RuntimeError(self._log.read_text()) from None
                time.sleep(0.1)
            else:
                return


@contextmanager
def running_server() -> Iterator[Server]:
    """Start a server; it is stopped and its folder removed at the end."""
    bin_folder = programs()
    if bin_folder is None:
        raise FileNotFoundError('PostgreSQL is not installed (package postgresql)')
    with tempfile.TemporaryDirectory(prefix='ivfmc-postgres-') as name:
        server = Server(Path(name), bin_folder)
        try:
            server.start()
            yield server
        finally:
            server.stop()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])
