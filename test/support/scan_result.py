# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a scan, from the ``scan_status`` that a client of the tests has received."""

from collections.abc import Callable
import json
from typing import Any


def await_result(
    client: Any, scan_id: str, seconds: float, on_poll: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """
    Return the result of a scan when it has ended.

    seconds : after which the test fails
    on_poll : called before each look at the status
    """

    def result() -> str:
        on_poll()
        values = {item.key: item.value for item in client.status[-1].values}
        return str(values['result']) if values.get('scan_id') == scan_id else ''

    client.until(result, seconds, 'the scan has not ended')
    found: dict[str, Any] = json.loads(result())
    return found
