# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page asks of the cell, and the answer to the person who asked."""

from collections.abc import Callable
from concurrent.futures import Future
import json
import logging
from typing import Any
from typing import Protocol

from ivfmc_ros.errors import ScanError

_TIMEOUT_S = 30.0
_LOG = logging.getLogger(__name__)


class Actions(Protocol):
    """The cell; each method returns at once, and the future has the answer or a ScanError."""

    def start(self, values: dict[str, Any]) -> 'Future[Any]':
        """Start a scan with these parameters of the orchestrator."""

    def control(self, request: str) -> 'Future[Any]':
        """Pause, resume or cancel the scan."""

    def set_value(self, node: str, name: str, value: float) -> 'Future[Any]':
        """Set a parameter of camera or turntable."""

    def light(self, laser: str, on: bool) -> 'Future[Any]':
        """Switch a laser by hand, in an idle cell and for a limited time."""

    def jog(self, radians: float) -> 'Future[Any]':
        """Turn the table of an idle cell by an angle."""


def answered(event: Any, call: 'Callable[[], Future[Any]]', done: str) -> Any:
    """
    Make a call for a person, and tell the person's browser what came of it.

    event : of viser, whose client gets the notification
    done : what is said when it went well; '' for nothing
    :returns: the answer, None after an error
    """
    try:
        answer = call().result(_TIMEOUT_S)
    except ScanError as error:
        _notify(event, error.code, str(error), 'red')
        return None
    except TimeoutError:
        _notify(event, 'TIMEOUT', f'no answer within {_TIMEOUT_S:.0f} s', 'red')
        return None
    except Exception as error:  # a person must not wait for an answer that never comes
        _LOG.exception('a request of the page failed')
        _notify(event, 'INTERNAL', f'{type(error).__name__}: {error}', 'red')
        return None
    if done:
        _notify(event, done, _text_of(answer), 'green')
    return answer


def _notify(event: Any, title: str, body: str, color: str) -> None:
    if event is not None and event.client is not None:
        event.client.add_notification(title, body, color=color, auto_close_seconds=8.0)


def _text_of(answer: Any) -> str:
    if not isinstance(answer, dict):
        return ''
    kept = {key: value for key, value in answer.items() if key != 'code'}
    return ', '.join(f'{key} {value}' for key, value in kept.items() if not _is_nested(value))


def _is_nested(value: Any) -> bool:
    return isinstance(value, dict | list) or len(json.dumps(value, default=str)) > 80
