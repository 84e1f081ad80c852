# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cell of separate processes, started by ``ivfmc up``, and the search for leftover ones."""

import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from support.graph_rig import node_environment


class Cell:
    """
    A process ``ivfmc up`` and the processes that it started.

    environment : further variables; PYTHONPATH is added to the one of the nodes
    """

    MODULE = 'ivfmc_ros.cli.main'

    def __init__(self, folder, *arguments, **environment):
        self.folder = folder
        self.scans = folder / 'scans'
        self.up = subprocess.Popen(
            [sys.executable, '-m', self.MODULE, 'up', '--folder', folder, *arguments],
            env=_with(node_environment(), environment),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def processes(self):
        """Process ids of the cell, orphans included."""
        mark = str(self.folder).encode()
        found = set()
        for place in Path('/proc').glob('[0-9]*'):
            try:
                words = (place / 'cmdline').read_bytes()
                environment = (place / 'environ').read_bytes()
                state = (place / 'stat').read_text().rpartition(')')[2].split()[0]
            except OSError:
                continue
            if state != 'Z' and (mark in words or b'ROS_LOG_DIR=' + mark in environment):
                found.add(int(place.name))
        return found

    def end(self, number=signal.SIGINT, seconds=30.0):
        self.up.send_signal(number)
        return self.up.wait(seconds)

    def kill(self):
        """Kill all processes of the cell, orphans included, and await their end."""
        if self.up.poll() is None:
            self.up.kill()
        self.up.wait()
        while found := self.processes():
            for pid in found:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.05)

    def log(self):
        """The text of up.log."""
        path = self.folder / 'up.log'
        return path.read_text() if path.exists() else ''

    def id_of(self, node):
        """Process id of a node."""
        for pid in self.processes():
            words = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
            if f'ivfmc_ros.nodes.{node}' in words:
                return pid
        raise AssertionError(f'{node} does not run: {self.log()}')


def _with(environment, further):
    paths = [found['PYTHONPATH'] for found in (environment, further) if found.get('PYTHONPATH')]
    return {**environment, **further, 'PYTHONPATH': os.pathsep.join(paths)}


def gone(cell, seconds=10.0):
    """Return whether all processes of the cell end within ``seconds``."""
    deadline = time.monotonic() + seconds
    while cell.processes():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
