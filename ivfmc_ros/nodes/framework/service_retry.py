# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Repeated sending of service responses to clients that the service has not discovered yet.

A client takes a service for ready once it has discovered both endpoints of the service; the
service may not have discovered those of the client yet. rmw_fastrtps then waits 0.1 s for the
client's reader and drops the response, rclpy only warns, and the client waits forever. On a busy
machine discovery takes longer than that.
"""

from collections.abc import Callable
from typing import Any
import warnings

# Seconds between two attempts; each may block the executor for the 0.1 s of rmw_fastrtps.
RETRY_S = 0.2
# Seconds of attempts after which the response is dropped with a warning.
TIMEOUT_S = 10.0


def retry_responses(service: Any, later: Callable[[float, Callable[[], None]], None]) -> Any:
    """
    Let a service repeat a response that could not be sent, for up to ``TIMEOUT_S``.

    service : an rclpy Service, modified in place and returned
    later : called with (seconds, function); calls the function then, on the service's executor
    """
    send = service.send_response

    def attempt(response: Any, header: Any, left_s: float) -> None:
        failure = _send(send, response, header)
        if not failure:
            return
        if left_s <= 0.0:
            warnings.warn(f'{service.srv_name}: {failure}', RuntimeWarning, stacklevel=2)
            return
        later(RETRY_S, lambda: attempt(response, header, left_s - RETRY_S))

    service.send_response = lambda response, header: attempt(response, header, TIMEOUT_S)
    return service


def _send(send: Callable[[Any, Any], None], response: Any, header: Any) -> str:
    """Send, and return the warning of rclpy that it failed; '' on success."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        send(response, header)
    lost = [warning for warning in caught if 'failed to send response' in str(warning.message)]
    for warning in caught:
        if warning not in lost:
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
    return str(lost[0].message) if lost else ''
