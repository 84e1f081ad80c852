# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A process that does one long job after the other, and can be killed.

Much of what takes long holds the interpreter's lock; in the process of a node it would stop the
heartbeat. ``python -m ivfmc_ros.worker FD`` takes (function, arguments) from an inherited socket
and gives back (True, result) or (False, exception).
"""

import ctypes
from multiprocessing.connection import Connection
import os
import signal
import socket
import subprocess
import sys
import threading
from typing import Any
from typing import Protocol

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ScanError

_PR_SET_PDEATHSIG = 1


class Job(Protocol):
    """A function of a module, so that the worker can import it."""

    def __call__(self, *arguments: Any) -> Any:
        """Do the work."""


class Worker:
    """
    The parent's end. Jobs are done in the order in which they are given.

    The process is started at once, because it takes a second to load what the jobs need.
    """

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._killed = False
        self._start()

    def run(self, job: Job, *arguments: Any) -> Any:
        """
        Do a job and wait for its result; for a thread that has nothing else to do.

        :raises CancelledError: ``kill`` was called
        :raises ScanError: what the job raised, or the worker died
        """
        with self._turn:
            if self._killed or self._process.poll() is not None:
                self._restart()
            connection = self._connection
            try:
                connection.send((job, arguments))
                done, result = connection.recv()
            except (EOFError, OSError) as error:
                if self._killed:
                    raise CancelledError('the work was cancelled') from error
                code = self._process.wait()
                raise ScanError(f'the process that did the work died ({code})') from error
        if not done:
            raise result
        return result

    def kill(self) -> None:
        """End the job that is being done; the next one gets a new process."""
        self._killed = True
        self._process.kill()

    def close(self) -> None:
        """End the process."""
        self.kill()
        self._process.wait()
        self._connection.close()

    def _restart(self) -> None:
        self.close()
        self._start()

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, '-m', 'ivfmc_ros.worker', str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
            )
        self._connection: Connection[Any, Any] = Connection(ours.detach())
        self._killed = False


def serve(connection: 'Connection[Any, Any]') -> None:
    """Do jobs until nobody is there to give one."""
    while True:
        try:
            job, arguments = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, job(*arguments)
        except Exception as error:
            answer = False, _portable(error)
        try:
            connection.send(answer)
        except OSError:
            return


def _portable(error: Exception) -> Exception:
    """Return an exception that survives the way to the parent."""
    if isinstance(error, ScanError):
        return error
    return ScanError(f'{type(error).__name__}: {error}')


def main() -> None:
    """Run the worker's end."""
    # Ctrl-C goes to the whole group; the node decides when its worker ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == 'linux':
        # a node that is killed leaves nothing behind
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    os.nice(5)
    serve(Connection(int(sys.argv[1])))


if __name__ == '__main__':
    main()
