# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bag that the tests of other formats write in theirs."""

import pytest


@pytest.fixture
def ours(write_bag):
    return write_bag(count=12)
