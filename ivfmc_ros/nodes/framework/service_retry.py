# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Answers of services that reach whoever asks in the moment of being discovered.

A client sees a service as ready once it knows the service's two endpoints; the service may still
have to learn of the client's. rmw_fastrtps then waits 0.1 s for the client's reader, gives the
answer up, and rclpy only warns: the client waits for ever. On a busy machine discovery takes
longer than that.
"""

from collections.abc import Callable
from typing import Any
import warnings

# Between two attempts, for the node's other work, each attempt may itself hold it up 0.1 s.
RETRY_S = 0.2
PATIENCE_S = 10.0


def persistent(service: Any, later: Callable[[float, Callable[[], None]], None]) -> Any:
    """
    Make a service send its answers again until the one who asked can hear them.

    service : an rclpy Service, changed in place and returned
    later : calls a function after so many seconds, on the executor of the service
    """
    send = service.send_response

    def attempt(response: Any, header: Any, left_s: float) -> None:
        complaint = _complaint(send, response, header)
        if not complaint:
            return
        if left_s <= 0.0:
            warnings.warn(f'{service.srv_name}: {complaint}', RuntimeWarning, stacklevel=2)
            return
        later(RETRY_S, lambda: attempt(response, header, left_s - RETRY_S))

    service.send_response = lambda response, header: attempt(response, header, PATIENCE_S)
    return service


def _complaint(send: Callable[[Any, Any], None], response: Any, header: Any) -> str:
    """Send, and return the warning that it was in vain; '' when it was sent."""
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
