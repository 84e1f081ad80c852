# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Child processes that run together: output in one place, and all are ended together."""

from collections.abc import Callable
from collections.abc import Collection
from collections.abc import Mapping
from collections.abc import Sequence
import contextlib
from dataclasses import dataclass
import os
import signal
import subprocess
import sys
import threading
import time
from types import TracebackType
from typing import Self

from ivfmc_ros.errors import HelperError

# Seconds that a program has after each signal. Not SIGINT: a program that is still importing its
# modules would answer it by a traceback.
_PATIENCE = ((signal.SIGTERM, 10.0), (signal.SIGKILL, 4.0))
_POLL_S = 0.05

Say = Callable[[str, str], None]


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A program that ended by itself."""

    name: str
    code: int

    def __str__(self) -> str:
        if self.code < 0:
            return f'{self.name} was killed by signal {-self.code}'
        return f'{self.name} ended with exit code {self.code}'


class Processes:
    """
    Processes that run together; the end of the ``with`` block ends all of them.

    say : called with (name of the process, line), from several threads
    codes : exit codes by name after the end, negative for a signal
    """

    def __init__(self, say: Say) -> None:
        self._say = say
        self._lock = threading.Lock()
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._programs: dict[str, tuple[Sequence[str], Mapping[str, str]]] = {}
        # names of programs on which those that were started later depend
        self._required: set[str] = set()
        self._readers: list[threading.Thread] = []
        self.codes: dict[str, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    @property
    def ids(self) -> dict[str, int]:
        """Process ids by name, of what has not been seen to end."""
        return {name: process.pid for name, process in self._running.items()}

    def start(
        self,
        name: str,
        program: Sequence[str],
        environment: Mapping[str, str],
        ready: str | None = None,
        seconds: float = 60.0,
    ) -> None:
        """
        Start a program.

        ready : wait until it writes this line; at most ``seconds``. What is started later depends
            on this program and is ended before it
        :raises HelperError: it ended, or did not become ready
        """
        self._programs[name] = program, environment
        if ready is not None:
            self._required.add(name)
        seen = threading.Event()
        process = self._launch(name, ready, seen)
        if ready is not None:
            self._await(name, process, seen, seconds)

    def restart(self, name: str) -> None:
        """Start a program again that has ended, in its place in the order of the end."""
        # it may have left children
        _signal(self._running[name].pid, signal.SIGKILL, group=True)
        self._launch(name, None, threading.Event())

    def _launch(
        self, name: str, ready: str | None, seen: threading.Event
    ) -> 'subprocess.Popen[str]':
        program, environment = self._programs[name]
        command = [sys.executable, '-m', 'ivfmc_ros.cli.support.child', str(os.getpid()), *program]
        process = subprocess.Popen(
            command,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            bufsize=1,
            # Ctrl-C in the terminal reaches this process alone, so that it can end the others in
            # order; children of a child are found by their process group
            start_new_session=True,
        )
        self._running[name] = process
        reader = threading.Thread(
            target=self._read, args=(name, process, ready, seen), daemon=True
        )
        reader.start()
        self._readers.append(reader)
        return process

    def ended(self, known: Collection[str] = ()) -> Ended | None:
        """Return a program that has ended by itself and is not ``known``, if there is one."""
        for name, process in self._running.items():
            code = process.poll()
            if code is not None and name not in known:
                return Ended(name=name, code=code)
        return None

    def code_of(self, name: str) -> int | None:
        """Return the exit code of a program, None while it runs."""
        return self._running[name].poll()

    def kill(self, name: str) -> None:
        """Kill a program and what it has started, also where it is stopped, and wait for that."""
        process = self._running.get(name)
        if process is not None:
            _signal(process.pid, signal.SIGKILL, group=True)
            _wait([process], _PATIENCE[-1][1])

    def stop(self) -> None:
        """End all programs and what they have started; first those that depend on others."""
        self._end([p for name, p in self._running.items() if name not in self._required])
        self._end([self._running[name] for name in self._required & self._running.keys()])
        for process in self._running.values():
            # a program that ended badly may have left children
            _signal(process.pid, signal.SIGKILL, group=True)
        self.codes = {name: p.returncode or 0 for name, p in self._running.items()}
        self._running.clear()
        for reader in self._readers:
            reader.join(timeout=1.0)

    def _end(self, processes: Sequence['subprocess.Popen[str]']) -> None:
        for number, seconds in _PATIENCE:
            alive = [process for process in processes if process.poll() is None]
            for process in alive:
                _signal(process.pid, number, group=number is signal.SIGKILL)
            _wait(alive, seconds)

    def _await(
        self, name: str, process: subprocess.Popen[str], seen: threading.Event, seconds: float
    ) -> None:
        deadline = time.monotonic() + seconds
        while not seen.wait(_POLL_S):
            if process.poll() is not None:
                raise HelperError('NOT_STARTED', str(Ended(name=name, code=process.poll() or 0)))
            if time.monotonic() > deadline:
                raise HelperError('NOT_STARTED', f'{name} was not ready after {seconds:.0f} s')

    def _read(
        self,
        name: str,
        process: subprocess.Popen[str],
        ready: str | None,
        seen: threading.Event,
    ) -> None:
        if process.stdout is None:
            return
        for line in process.stdout:
            text = line.rstrip('\n')
            if ready is not None and text.strip() == ready:
                seen.set()
            # the pipe must be read even if the log fails: a full pipe blocks the process
            with self._lock, contextlib.suppress(OSError, ValueError):
                self._say(name, text)


def _signal(pid: int, number: signal.Signals, *, group: bool) -> None:
    try:
        (os.killpg if group else os.kill)(pid, number)
    except (ProcessLookupError, PermissionError):
        return  # it is gone


def _wait(processes: Sequence[subprocess.Popen[str]], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    for process in processes:
        try:
            process.wait(timeout=max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return
