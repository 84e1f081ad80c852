# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
import zlib

import pytest

from ivfmc_ros.storage.bag.crc32 import combined_crc


@pytest.mark.parametrize('first', [0, 1, 9, 1000])
@pytest.mark.parametrize('second', [0, 1, 7, 4096, 1_310_777])
def test_crc_of_two_parts_is_that_of_the_whole(first, second):
    head, tail = os.urandom(first), os.urandom(second)
    assert combined_crc(zlib.crc32(head), zlib.crc32(tail), second) == zlib.crc32(head + tail)
