# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The scan service of a cell for the threads of a server.

One thread, which runs ``CellGateway.run``, talks to the cell. Servers hand it requests and get
futures; a status that changes is handed to the listeners.
"""

from collections.abc import Callable
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from dataclasses import fields
import json
import queue
import threading
from typing import Any

from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.scan.request import ScanRequest

ACTIONS = ('start', 'cancel', 'pause', 'resume')
# What a client may set of a scan; the limits of the machine and all paths are the operator's.
SETTABLE = tuple(item.name for item in fields(ScanRequest))

_SERVICES = {'start': 'start_scan', 'cancel': 'cancel', 'pause': 'pause', 'resume': 'resume'}
_SPIN_S = 0.05
# Seconds without a heartbeat of the orchestrator after which the cell is not alive.
_SILENCE_S = 5.0
# Requests that wait at most; the cell answers each within milliseconds.
_MAX_WAITING = 32

Listener = Callable[['CellState'], None]


@dataclass(frozen=True, kw_only=True)
class CellState:
    """
    What is known of the cell.

    alive : its orchestrator gives heartbeats
    status : the values of scan_status; ``result`` is the parsed answer, None before the end
    """

    alive: bool
    status: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-serializable values."""
        return {'alive': self.alive, **self.status}


@dataclass(frozen=True, kw_only=True)
class _Request:
    action: str
    values: Mapping[str, Any]
    answer: 'Future[dict[str, Any]]'


class CellGateway:
    """
    Serializes the requests of all clients, and follows ``scan_status``.

    ``run`` is for one thread, everything else for any.
    """

    def __init__(self, client: CellClient) -> None:
        self._client = client
        self._requests: queue.Queue[_Request] = queue.Queue(_MAX_WAITING)
        self._listeners: list[Listener] = []
        self._lock = threading.Lock()
        self._state = CellState(alive=False, status={})
        # the status of the client that was parsed last
        self._parsed: Mapping[str, str] = {}

    @property
    def state(self) -> CellState:
        """What is known of the cell now."""
        with self._lock:
            return self._state

    def listen(self, listener: Listener) -> Callable[[], None]:
        """
        Call ``listener`` with the present state and each later one; it must return at once.

        :returns: a function that ends this
        """
        with self._lock:
            self._listeners.append(listener)
            state = self._state
        listener(state)

        def end() -> None:
            with self._lock:
                self._listeners.remove(listener)

        return end

    def request(
        self, action: str, values: Mapping[str, Any] | None = None
    ) -> 'Future[dict[str, Any]]':
        """
        Ask the cell for an action.

        values : parameters of a scan that starts, see ``SETTABLE``; they hold for this scan only
        returns : future of the answer; its exception is a ScanError with the code of the cell
        :raises ParameterError: the action or a parameter is unknown
        :raises HelperError: BUSY, too many requests wait
        """
        if action not in ACTIONS:
            raise ParameterError(f'action: {action!r} is not one of {", ".join(ACTIONS)}')
        given = dict(values or {})
        unknown = [name for name in given if name not in SETTABLE or action != 'start']
        if unknown:
            raise ParameterError(
                f'{unknown[0]!r} cannot be set; {action} takes '
                f'{", ".join(SETTABLE) if action == "start" else "no parameters"}'
            )
        answer: Future[dict[str, Any]] = Future()
        try:
            self._requests.put_nowait(_Request(action=action, values=given, answer=answer))
        except queue.Full:
            raise HelperError('BUSY', 'too many requests wait for the cell') from None
        return answer

    def run(self, ending: threading.Event) -> None:
        """Talk to the cell until ``ending`` is set."""
        try:
            while not ending.is_set():
                self._client.spin(_SPIN_S)
                self._follow()
                self._answer_next()
        finally:
            self._refuse_waiting()

    def _follow(self) -> None:
        given, alive = self._client.status, self._client.silent_s < _SILENCE_S
        if given is self._parsed and alive == self._state.alive:
            return
        self._parsed = given
        text = given.get('result')
        status = {**given, 'result': json.loads(text) if text else None}
        state = CellState(alive=alive, status=status)
        with self._lock:
            if state == self._state:
                return
            self._state = state
            listeners = list(self._listeners)
        for listener in listeners:
            listener(state)

    def _answer_next(self) -> None:
        try:
            request = self._requests.get_nowait()
        except queue.Empty:
            return
        if not request.answer.set_running_or_notify_cancel():
            return
        try:
            with self._client.parameters('orchestrator', dict(request.values)):
                answer = self._client.trigger(_SERVICES[request.action])
        except ScanError as error:
            request.answer.set_exception(error)
        except Exception as error:  # a client must not wait for an answer that never comes
            request.answer.set_exception(HelperError('INTERNAL', f'{error}'))
        else:
            # once: the former parameters are restored, which may fail as well
            request.answer.set_result(answer)

    def _refuse_waiting(self) -> None:
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                return
            if request.answer.set_running_or_notify_cancel():
                request.answer.set_exception(HelperError('INTERRUPTED', 'the gateway ends'))
