# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A clock that a test sets."""


class Clock:
    """Returns ``now_s``, seconds."""

    now_s = 0.0

    def __call__(self):
        return self.now_s
