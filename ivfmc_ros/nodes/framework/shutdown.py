# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The end of a node: its request by a signal, and the delivery of the last message."""

import signal
from typing import Any

from rclpy.duration import Duration

# Seconds that a node may take to shut down: turntable and recorder need up to 10.
SHUTDOWN_S = 20.0
# Seconds to wait for subscriptions to receive the last message; one that hangs never does.
_FLUSH_S = 0.5


class ShutdownRequest:
    """The request of a signal to end; ``reason`` is '' before."""

    def __init__(self) -> None:
        self.reason = ''

    def request(self, number: int) -> None:
        """Set the reason, and have the process killed where its end hangs."""
        if not self.reason:
            self.reason = f'signal {signal.Signals(number).name} received'
            # by the kernel: a thread would not be scheduled while the interpreter hangs
            signal.setitimer(signal.ITIMER_REAL, SHUTDOWN_S)


def flush(publisher: Any) -> None:
    """Wait until the subscriptions have what was published, for a limited time."""
    # otherwise the end of the process overtakes the message
    publisher.wait_for_all_acked(Duration(seconds=_FLUSH_S))
