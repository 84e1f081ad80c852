# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timers whose period changes: fast while something happens, slow in an idle cell."""

from typing import Any

_NS = 1_000_000_000


def set_period(timer: Any, period_s: float) -> None:
    """Let a timer call every ``period_s`` seconds from now on; nothing where it does already."""
    period_ns = round(period_s * _NS)
    if timer.timer_period_ns != period_ns:
        timer.timer_period_ns = period_ns
        timer.reset()
