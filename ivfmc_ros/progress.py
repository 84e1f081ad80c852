# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Callback by which a long job reports its progress."""

from collections.abc import Callable

# (stage, items done, items in total)
Progress = Callable[[str, int, int], None]


def no_progress(stage: str, done: int, total: int) -> None:
    """Ignore the progress; the default callback."""
