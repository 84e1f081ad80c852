# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.watch import Watch


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def test_who_was_just_heard_is_alive():
    clock = Clock()
    watch = Watch(1.0, clock)
    watch.hear('camera')
    clock.now += 0.9
    watch.require(['camera'])
    assert watch.age('camera') == pytest.approx(0.9)


def test_silence_is_named_with_its_age():
    clock = Clock()
    watch = Watch(1.0, clock)
    watch.hear('camera')
    clock.now += 1.5
    with pytest.raises(HelperError, match=r'camera silent for 1\.5 s') as caught:
        watch.require(['camera'])
    assert caught.value.code == 'CAMERA_LOST'


def test_who_was_never_heard_is_lost():
    with pytest.raises(HelperError, match='mesher never heard of'):
        Watch(1.0).require(['mesher'])


@pytest.mark.parametrize('limit', [0.0, -1.0, math.nan])
def test_limit_that_is_no_time_is_refused(limit):
    with pytest.raises(ParameterError, match='limit'):
        Watch(limit)
