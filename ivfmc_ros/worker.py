# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A child process that runs one long job after the other, and can be killed.

Many long calls of Open3D hold the global interpreter lock; in the process of a node they would
stop its heartbeat. ``python -m ivfmc_ros.worker FD MODULE...`` imports the modules, then receives
(function, arguments) on an inherited socket and sends (True, result) or (False, exception).
"""

from collections.abc import Callable
from collections.abc import Sequence
from concurrent.futures import Future
import ctypes
import importlib
from multiprocessing.connection import Connection
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
from typing import Any
from typing import Protocol

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ScanError

# Option of Linux' prctl(2): the signal that the process gets when its parent dies.
_PR_SET_PDEATHSIG = 1
# The worker's nice value; nodes with deadlines come first.
_NICE = 5

_Process = tuple['subprocess.Popen[bytes]', 'Connection[Any, Any]']


class Job(Protocol):
    """A module-level function, which the worker can import."""

    def __call__(self, *arguments: Any) -> Any:
        """Run the job."""


class Worker:
    """
    The parent's side of a worker process. Jobs run in the order in which they are submitted.

    The process is started at once and imports ``modules``, which takes seconds, so that the first
    job does not wait for them. A thread that lives as long as this object starts it: for the
    kernel the parent of a process is the thread that forked it, and PR_SET_PDEATHSIG kills the
    process when that thread ends.
    """

    def __init__(self, modules: Sequence[str] = ()) -> None:
        """``modules`` : names of modules that the process imports before the first job."""
        self._modules = tuple(modules)
        # one job at a time
        self._lock = threading.Lock()
        # of the process: a kill falls before or after the start of a job, never into it
        self._state = threading.Lock()
        self._killed = False
        self._starts: queue.Queue[Future[_Process] | None] = queue.Queue()
        launcher = threading.Thread(target=self._launch, name='worker launcher', daemon=True)
        launcher.start()
        self._process, self._connection = self._start()

    def run(self, job: Job, *arguments: Any, cancelled: Callable[[], bool] = lambda: False) -> Any:
        """
        Run a job and block until its result is there.

        job : a module-level function; arguments and result must be picklable
        cancelled : asked once before the job begins; to be true before ``kill`` is called
        :raises CancelledError: ``cancelled`` was true, or ``kill`` was called
        :raises ScanError: the job raised an exception, or the worker died
        """
        with self._lock:
            with self._state:
                if cancelled():
                    raise CancelledError('the work was cancelled')
                if self._killed or self._process.poll() is not None:
                    self._restart()
                process, connection = self._process, self._connection
            try:
                connection.send((job, arguments))
                done, result = connection.recv()
            except (EOFError, OSError) as error:
                if self._killed:
                    raise CancelledError('the work was cancelled') from error
                code = process.wait()
                raise ScanError(f'the process that did the work died ({code})') from error
        if not done:
            raise result
        return result

    def kill(self) -> None:
        """Kill the process and its current job; the next job starts a new process."""
        with self._state:
            self._killed = True
            self._process.kill()

    def close(self) -> None:
        """Kill the process, release its socket, and end the thread that starts processes."""
        self.kill()
        self._process.wait()
        self._connection.close()
        self._starts.put(None)

    def _restart(self) -> None:
        self._process.kill()
        self._process.wait()
        self._connection.close()
        self._process, self._connection = self._start()
        self._killed = False

    def _start(self) -> _Process:
        started: Future[_Process] = Future()
        self._starts.put(started)
        return started.result()

    def _launch(self) -> None:
        while (started := self._starts.get()) is not None:
            try:
                started.set_result(_start_process(self._modules))
            except OSError as error:
                failure = ScanError(f'the process for long jobs cannot be started: {error}')
                started.set_exception(failure)


def _start_process(modules: Sequence[str]) -> _Process:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        process = subprocess.Popen(
            [sys.executable, '-m', 'ivfmc_ros.worker', str(theirs.fileno()), *modules],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
        )
        return process, Connection(ours.detach())


def serve(connection: 'Connection[Any, Any]') -> None:
    """Run jobs until the parent closes the connection."""
    while True:
        try:
            job, arguments = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, job(*arguments)
        except Exception as error:
            answer = False, _picklable(error)
        try:
            connection.send(answer)
        except OSError:
            return


def _picklable(error: Exception) -> Exception:
    """Return an exception that the parent can unpickle."""
    if isinstance(error, ScanError):
        return error
    return ScanError(f'{type(error).__name__}: {error}')


def end_with_parent() -> None:
    """
    Let the kernel kill this process when its parent dies, and ignore Ctrl-C, on Linux.

    Ctrl-C signals the whole process group; the parent decides when its children end.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == 'linux':
        # the child of a node that was killed must not live on
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def main() -> None:
    """Run the worker process."""
    end_with_parent()
    os.nice(_NICE)
    for module in sys.argv[2:]:
        importlib.import_module(module)
    serve(Connection(int(sys.argv[1])))


if __name__ == '__main__':
    main()
